"""What is learned about the person, the detector and the camera: bone lengths, height, mean posture, errors,
vertical.
"""
