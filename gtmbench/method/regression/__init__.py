"""From records to one triangular array: the equations of an operator, reduced without ever being formed."""
