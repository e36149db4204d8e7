"""How tracking goes, in words and figures: /diagnostics, ~/state, the reasons of rejected frames."""
