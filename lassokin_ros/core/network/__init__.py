"""The depth network: its features, layers and weights, and the estimator that feeds it one person's keypoints."""
