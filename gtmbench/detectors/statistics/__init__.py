"""What residuals are judged by: whitening, test statistics, thresholds, parameter uncertainty."""
