"""Which images to take for a wanted depth sigma, predicted by the estimator's own covariance."""
