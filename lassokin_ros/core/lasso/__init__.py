"""The frame's lasso: problem, dual, active set, certificate, and Theorem 1."""
