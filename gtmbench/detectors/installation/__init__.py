"""How sensors are installed: lags, clocks, scales and axes of gyros and attitude, learnt and undone."""
