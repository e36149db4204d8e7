"""From an estimate to output messages: topics, URDF, diagnostics, texts."""
