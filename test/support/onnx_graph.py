"""ONNX models that the tests build, node by node."""

import numpy as np

COCO = 17


class Graph:
    """Adds nodes to an ONNX graph."""

    def __init__(self, onnx, dtype, shape):
        self.onnx, self.nodes, self.constants = onnx, [], []
        self.input = onnx.helper.make_tensor_value_info("input", dtype, shape)

    def constant(self, value, dtype=np.float32):
        name = f"c{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def node(self, operator, *inputs, **attributes):
        name = f"n{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, list(inputs), [name], **attributes))
        return name

    def save(self, path, outputs, dtype=None):
        """outputs: [(name, value, declared shape)]."""
        helper = self.onnx.helper
        dtype = dtype or self.onnx.TensorProto.FLOAT
        nodes = [*self.nodes, *(helper.make_node("Identity", [value], [name]) for name, value, _ in outputs)]
        infos = [helper.make_tensor_value_info(name, dtype, shape) for name, _, shape in outputs]
        graph = helper.make_graph(nodes, "pose", [self.input], infos, self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        self.onnx.save(model, path)
        return str(path)

    def reddest(self, image, height, width):
        """x and y (1, 1) of the reddest pixel; image: (1, 3, h, w)."""
        red = self.node("Slice", image, *(self.constant(v, np.int64) for v in ([0], [1], [1])))
        flat = self.node("Reshape", red, self.constant([1, height * width], np.int64))
        place = self.node("ArgMax", self.node("Round", flat), axis=1, keepdims=1)
        side = self.constant(width, np.int64)
        x, y = self.node("Mod", place, side), self.node("Div", place, side)
        return [self.node("Cast", value, to=self.onnx.TensorProto.FLOAT) for value in (x, y)]

    def row(self, *parts):
        """Parts (1, 1), joined and repeated to (1, 17, n)."""
        joined = self.node("Concat", *parts, axis=1)
        return self.node("Expand", joined, self.constant([1, COCO, len(parts)], np.int64))
