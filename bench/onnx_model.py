"""The network that Headway serves with the settings of the paper, as an ONNX graph: what the benchmarks give to ONNX Runtime.

    python3 bench/onnx_model.py model.onnx [--hidden 128] [--horizon 10]

Input `window`, float32 [n, horizon, 4]: follower speed, leader speed, relative speed, spacing of each step, oldest first.
Output `accel_mps2`, float32 [n, 1]. Standardisation, an LSTM over the window from a zero state, a linear head on its last
state, and limit * tanh of it, as in `src/driver`. The weights are random, at the scale PyTorch starts from: time does not
depend on them. Needs numpy and onnx.
"""

import argparse

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

INPUTS = 4


def build(hidden=128, horizon=10, limit_mps2=4.0, seed=42):
    """The graph as an `onnx.ModelProto`."""
    rng = np.random.default_rng(seed)
    scale = 1 / np.sqrt(hidden)
    uniform = lambda *shape: rng.uniform(-scale, scale, shape).astype(np.float32)
    constants = {
        "mean": np.array([12.0, 12.0, 0.0, 20.0], np.float32),
        "spread": np.array([6.0, 6.0, 1.5, 10.0], np.float32),
        "w": uniform(1, 4 * hidden, INPUTS),
        "r": uniform(1, 4 * hidden, hidden),
        "b": np.concatenate([uniform(1, 4 * hidden), np.zeros((1, 4 * hidden), np.float32)], axis=1),
        "head_w": uniform(1, hidden),
        "head_b": uniform(1),
        "limit": np.array(limit_mps2, np.float32),
        "directions": np.array([0], np.int64),
    }
    nodes = [
        helper.make_node("Sub", ["window", "mean"], ["centred"]),
        helper.make_node("Div", ["centred", "spread"], ["standardised"]),
        # ONNX's LSTM wants [steps, n, inputs].
        helper.make_node("Transpose", ["standardised"], ["by_step"], perm=[1, 0, 2]),
        helper.make_node("LSTM", ["by_step", "w", "r", "b"], ["", "last"], hidden_size=hidden),
        helper.make_node("Squeeze", ["last", "directions"], ["state"]),
        helper.make_node("Gemm", ["state", "head_w", "head_b"], ["head"], transB=1),
        helper.make_node("Tanh", ["head"], ["squashed"]),
        helper.make_node("Mul", ["squashed", "limit"], ["accel_mps2"]),
    ]
    graph = helper.make_graph(
        nodes,
        "headway",
        [helper.make_tensor_value_info("window", TensorProto.FLOAT, ["n", horizon, INPUTS])],
        [helper.make_tensor_value_info("accel_mps2", TensorProto.FLOAT, ["n", 1])],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    return model


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("path")
    cli.add_argument("--hidden", type=int, default=128)
    cli.add_argument("--horizon", type=int, default=10)
    args = cli.parse_args()
    onnx.save(build(args.hidden, args.horizon), args.path)


if __name__ == "__main__":
    main()
