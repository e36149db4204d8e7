"""Other explanations of the image: initialisation, alternative bodies and limbs, the network's pose, re-initialisation.

`replacement` decides when one of them replaces the tracked pose.
"""
