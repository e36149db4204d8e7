"""The frame's lasso: problem, dual, active set, certificate, increment, and Theorem 1."""
