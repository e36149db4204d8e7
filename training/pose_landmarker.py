"""MediaPipe's models of the pose or of a hand as one file for its Tasks API, from the wheel of an earlier release.

    pip download --no-deps --only-binary :all: --python-version 3.12 --platform manylinux_2_28_x86_64 mediapipe==0.10.21
    python -m training.pose_landmarker mediapipe-0.10.21-*.whl --output FILE   # needs pip install '.[mediapipe]'
    python -m training.pose_landmarker mediapipe-0.10.21-*.whl --hand --output FILE

A file of the Tasks API (`.task`) is a zip of two networks without compression: one finds the person or the palm, the
other one the landmarks. The second one of the pose lacks in the wheel the metadata that the Tasks API reads, so they
are added: pixels are from 0 to 1. The weights are unchanged. The same wheel gives the same bytes.
"""

from __future__ import annotations

import argparse
import zipfile
from collections.abc import Sequence
from pathlib import Path

import flatbuffers
from mediapipe.tasks.metadata import metadata_schema_py_generated as metadata
from mediapipe.tasks.metadata import schema_py_generated as schema

DETECTOR = "mediapipe/modules/pose_detection/pose_detection.tflite"
LANDMARKS = "mediapipe/modules/pose_landmark/pose_landmark_full.tflite"
PALM = "mediapipe/modules/palm_detection/palm_detection_full.tflite"
HAND = "mediapipe/modules/hand_landmark/hand_landmark_full.tflite"
ABOUT = (
    "Pose landmark model (full) of MediaPipe 0.10.21, Copyright The MediaPipe Authors. Changed for lassokin_ros: these "
    "metadata were added."
)
DAY = (1980, 1, 1, 0, 0, 0)
ALIGNMENT = 4
"""Bytes: MediaPipe maps the networks into memory where they lie in the file."""
HEADER = 30
"""Bytes of a zip's local header, without the name."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--hand", action="store_true", help="the model of a hand instead of the pose")
    parser.add_argument("--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    with zipfile.ZipFile(options.wheel) as wheel:
        if options.hand:
            networks = {"hand_detector.tflite": wheel.read(PALM), "hand_landmarks_detector.tflite": wheel.read(HAND)}
        else:
            networks = {
                "pose_detector.tflite": wheel.read(DETECTOR),
                "pose_landmarks_detector.tflite": with_metadata(wheel.read(LANDMARKS)),
            }
    with zipfile.ZipFile(options.output, "w", zipfile.ZIP_STORED) as file:
        for name, data in networks.items():
            entry = zipfile.ZipInfo(name, DAY)
            entry.create_system = 3  # the same on each system
            begin = file.fp.tell() + HEADER + len(name) + ALIGNMENT  # a field of padding has a header of four bytes
            padding = -begin % ALIGNMENT
            entry.extra = b"\xfe\xca" + padding.to_bytes(2, "little") + bytes(padding)
            file.writestr(entry, data)


def with_metadata(network: bytes) -> bytes:
    """Return a network (TFLite) of one RGB image with pixels from 0 to 1, with metadata that say so."""
    image = metadata.TensorMetadataT()
    image.name = "image"
    image.content = metadata.ContentT()
    image.content.contentPropertiesType = metadata.ContentProperties.ImageProperties
    image.content.contentProperties = metadata.ImagePropertiesT()
    image.content.contentProperties.colorSpace = metadata.ColorSpaceType.RGB
    scale = metadata.ProcessUnitT()
    scale.optionsType = metadata.ProcessUnitOptions.NormalizationOptions
    scale.options = metadata.NormalizationOptionsT()
    scale.options.mean, scale.options.std = [0.0], [255.0]
    image.processUnits = [scale]

    model = schema.ModelT.InitFromObj(schema.Model.GetRootAs(bytearray(network), 0))
    graph = metadata.SubGraphMetadataT()
    graph.inputTensorMetadata, graph.outputTensorMetadata = [image], []
    for number in model.subgraphs[0].outputs:
        output = metadata.TensorMetadataT()
        output.name = model.subgraphs[0].tensors[number].name.decode()
        graph.outputTensorMetadata.append(output)
    about = metadata.ModelMetadataT()
    about.name, about.description, about.license = "pose landmarks", ABOUT, "Apache-2.0"
    about.subgraphMetadata = [graph]
    builder = flatbuffers.Builder(0)
    builder.Finish(about.Pack(builder), b"M001")

    buffer, entry = schema.BufferT(), schema.MetadataT()
    buffer.data = list(builder.Output())
    model.buffers.append(buffer)
    entry.name, entry.buffer = "TFLITE_METADATA", len(model.buffers) - 1
    model.metadata = [*(model.metadata or []), entry]
    builder = flatbuffers.Builder(len(network) + len(buffer.data))
    builder.Finish(model.Pack(builder), b"TFL3")
    return bytes(builder.Output())


if __name__ == "__main__":
    main()
