"""`lassokin measure`: what people ask of a gait or of exercises, from a video or an exported motion."""
