"""Other explanations of the image: initialisation, alternative bodies and limbs, re-initialisation."""
