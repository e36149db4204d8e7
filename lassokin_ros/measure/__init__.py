"""`lassokin measure`: what people ask of a gait or of squats, from an exported motion."""
