"""Writes tests/golden/npy: the same three events as NumPy writes them, of every kind that uploads take.

    python3 -m venv venv && venv/bin/pip install numpy==2.4.6 && venv/bin/python tests/golden/npy.py 2
    python3 -m venv one && one/bin/pip install numpy==1.26.4 && one/bin/python tests/golden/npy.py 1

NumPy 1 has other names for what pickles call, so both write. Event e has 12 + e steps; arrays of numbers have 12 of each.
"""

import pickle
import sys
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).resolve().parent / "npy"


def columns(event: int, steps: int) -> list[list[float]]:
    """Spacing, follower speed, relative speed, leader speed: numbers that 32 bits hold."""
    return [[20 + event + step / 8 for step in range(steps)], [10 + event / 4] * steps, [1.25] * steps,
            [11.25 + event / 4] * steps]


def cells(make) -> np.ndarray:
    """An array of objects, each made of the numbers of a column."""
    array = np.empty((3, 4), dtype=object)
    for event in range(3):
        for at, column in enumerate(columns(event, 12 + event)):
            array[event, at] = make(column)
    return array


def save(name: str, array: np.ndarray, protocol: int) -> None:
    """As numpy.save does, which offers no choice of protocol."""
    with open(FOLDER / f"{name}.npy", "wb") as file:
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(array))
        pickle.dump(array, file, protocol=protocol)


def main() -> None:
    major = sys.argv[1]
    if np.__version__.partition(".")[0] != major:
        sys.exit(f"NumPy {major} is wanted, {np.__version__} is here")
    FOLDER.mkdir(exist_ok=True)
    kinds = {"lists": list, "arrays": lambda column: np.array(column, dtype="f8"),
             "singles": lambda column: np.array(column, dtype=">f4"), "scalars": lambda column: list(np.array(column))}
    for kind, make in kinds.items():
        for protocol in range(2, 6):
            save(f"{kind}-{protocol}-numpy{major}", cells(make), protocol)
    np.save(FOLDER / f"saved-numpy{major}.npy", cells(list))
    if major == "2":
        numbers = np.array([columns(event, 12) for event in range(3)])
        for code in ("<f8", ">f8", "<f4", ">f4"):
            np.save(FOLDER / f"numbers-{'big' if code[0] == '>' else 'little'}-{code[1:]}.npy", numbers.astype(code))
        whole = np.round(numbers)
        for code in ("<i8", ">i4"):
            np.save(FOLDER / f"whole-{code[1:]}.npy", whole.astype(code))


main()
