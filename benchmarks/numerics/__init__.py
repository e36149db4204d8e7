"""Numerical properties: agreement of versions, drift over hours."""
