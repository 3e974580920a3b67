"""The contours of single frames: distance fields, residuals and Jacobians, normal equations, descent."""
