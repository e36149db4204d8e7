"""The camera of an image: selection by camera_info, lens, distortion, mount and transforms from TF, calibration files.

`msg_adapters.camera_info` decodes a message and checks its content.
"""
