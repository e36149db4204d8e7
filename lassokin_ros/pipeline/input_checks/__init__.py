"""Signs that an input is not what it seems: repeated, in another unit, of another detector or camera."""
