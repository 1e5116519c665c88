"""The network that Headway serves with the settings of the paper, as an ONNX graph: what the benchmarks give to ONNX Runtime.

Input `window`, float32 [n, horizon, 4]: follower speed, leader speed, relative speed, spacing of each step, oldest first.
Output `accel_mps2`, float32 [n, 1]. Standardisation, an LSTM over the window from a zero state, a linear head on its last
state, and limit * tanh of it, as in `src/driver`. The weights are random, at the scale PyTorch starts from: time does not
depend on them. Needs numpy and onnx.
"""

import itertools

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

HORIZON, INPUTS, LIMIT = 10, 4, 4.0
MEAN, SPREAD = np.array([8.0, 8.5, 0.3, 14.0], np.float32), np.array([3.0, 3.5, 1.2, 5.0], np.float32)


class Network:
    """Weights as torch lays them out: gates in the order input, forget, cell, output."""

    def __init__(self, hidden, seed=1):
        random, bound = np.random.default_rng(seed), hidden**-0.5
        draw = lambda *shape: random.uniform(-bound, bound, shape).astype(np.float32)
        self.hidden, self.input, self.recurrent = hidden, draw(4 * hidden, INPUTS), draw(4 * hidden, hidden)
        self.bias, self.head, self.head_bias = draw(4 * hidden), draw(hidden, 1), draw(1)

    def accelerations(self, windows):
        """The formulas, in double precision."""
        sigmoid = lambda x: 1.0 / (1.0 + np.exp(-x))
        x = (windows.astype(np.float64) - MEAN) / SPREAD
        h = c = np.zeros((len(windows), self.hidden))
        for t in range(HORIZON):
            z = x[:, t] @ self.input.T + h @ self.recurrent.T + self.bias
            i, f, g, o = np.split(z, 4, axis=1)
            c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
            h = sigmoid(o) * np.tanh(c)
        return LIMIT * np.tanh(h @ self.head + self.head_bias)

    def graph(self, kind):
        """The ONNX model, with the LSTM operator or step by step."""
        nodes, constants, number = [], {}, itertools.count()

        def constant(value):
            name = f"c{len(constants)}"
            constants[name] = numpy_helper.from_array(np.array(value, order="C"), name)
            return name

        def add(operator, *inputs, outputs=1, **attributes):
            names = [f"v{next(number)}" for _ in range(outputs)]
            nodes.append(helper.make_node(operator, list(inputs), names, **attributes))
            return names[0] if outputs == 1 else names

        x = add("Div", add("Sub", "window", constant(MEAN)), constant(SPREAD))
        h = (self.by_operator if kind == "operator" else self.by_steps)(x, add, constant)
        accel = add("Mul", add("Tanh", add("Gemm", h, constant(self.head), constant(self.head_bias))),
                    constant(np.float32(LIMIT)))
        nodes.append(helper.make_node("Identity", [accel], ["accel_mps2"]))
        value = lambda name, shape: helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
        graph = helper.make_graph(nodes, "driver", [value("window", ["n", HORIZON, INPUTS])], [value("accel_mps2", ["n", 1])],
                                  list(constants.values()))
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.checker.check_model(model)
        return model.SerializeToString()

    def by_operator(self, x, add, constant):
        def ordered(values):
            """ONNX wants the gates in the order input, output, forget, cell."""
            i, f, g, o = np.split(values, 4)
            return np.concatenate([i, o, f, g])[None]

        bias = np.concatenate([ordered(self.bias), np.zeros((1, 4 * self.hidden), np.float32)], axis=1)
        steps = add("Transpose", x, perm=[1, 0, 2])
        weights = [constant(ordered(self.input)), constant(ordered(self.recurrent)), constant(bias)]
        last = add("LSTM", steps, *weights, outputs=2, hidden_size=self.hidden)[1]
        return add("Squeeze", last, constant(np.array([0], np.int64)))

    def by_steps(self, x, add, constant):
        weights, recurrent, bias = constant(self.input), constant(self.recurrent), constant(self.bias)
        h = c = None
        for t in range(HORIZON):
            now = add("Gather", x, constant(np.array(t, np.int64)), axis=1)
            z = add("Gemm", now, weights, bias, transB=1)
            z = z if h is None else add("Gemm", h, recurrent, z, transB=1)
            i, f, g, o = add("Split", z, outputs=4, axis=1)
            new = add("Mul", add("Sigmoid", i), add("Tanh", g))
            c = new if c is None else add("Add", add("Mul", add("Sigmoid", f), c), new)
            h = add("Mul", add("Sigmoid", o), add("Tanh", c))
        return h
