"""Surrogates as files: numpy's npz with a JSON header, no pickle.

Reading a file runs nothing that is in it, and a surrogate read back gives the same predictions to the last bit.
"""

import json
import struct
import zipfile
import zlib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.sensitivity.surrogates.base import Surrogate
from tbm_gsa.sensitivity.surrogates.expansion import Expansion, KernelExpansion, PolynomialExpansion
from tbm_gsa.sensitivity.surrogates.samples import checked_samples
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import write_whole

FORMAT: Final = "tbm_monitor surrogate 1"
_WRITTEN: Final = "a file that `save_surrogate` wrote"

# What the zip reader, zlib, numpy and json say of bytes that are not what they should be.
_DAMAGED: Final = (
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    EOFError,
    OverflowError,
    MemoryError,
    SyntaxError,
    RuntimeError,
    struct.error,
    zlib.error,
    zipfile.BadZipFile,
)


def save_surrogate(model: Surrogate, path: str | Path) -> None:
    """Write a surrogate with its samples, without the effects of realisations; a file that is there is replaced."""
    header = {
        "format": FORMAT,
        "method": model.method,
        "transform": model.samples.transform,
        "seed": model.seed,
        "settings": dict(model.settings),
        "form": "kernel" if isinstance(model.expansion, KernelExpansion) else "polynomial",
    }
    samples = model.samples
    arrays: dict[str, ArrayLike] = {
        **vars(model.expansion),
        "X": samples.X,
        "y": samples.adjusted,
        "bounds": samples.bounds,
    }
    if samples.effects is not None:
        arrays["realisations"] = samples.effects.labels  # without them repeated points would contradict each other
    content = BytesIO()
    np.savez_compressed(content, allow_pickle=False, header=np.array(json.dumps(header)), **arrays)
    write_whole(Path(path), content.getvalue())


def read_surrogate(path: str | Path, methods: Mapping[str, type[Surrogate]]) -> Surrogate:
    """Read what `save_surrogate` wrote.

    Parameters
    ----------
    path : str or Path
    methods : mapping of str to type
        The surrogates that are known, by method.

    Raises
    ------
    InputError
        The file cannot be read, was not written by `save_surrogate`, or holds what no surrogate can.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            parts = {name: file[name] for name in file.files} if isinstance(file, np.lib.npyio.NpzFile) else {}
        header = json.loads(str(parts.pop("header")))
        if header["format"] != FORMAT:
            raise InputError(f"its format is {header['format']!r}")
        X, y, bounds = (parts.pop(name) for name in ("X", "y", "bounds"))
        samples = checked_samples(X, y, bounds, parts.pop("realisations", None)).under(header["transform"])
        expansion = _expansion(header["form"], parts, samples.X.shape[1])
        settings = {str(name): float(value) for name, value in header["settings"].items()}
        return methods[header["method"]](samples, expansion, settings, int(header["seed"]))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}), allowed: {_WRITTEN}") from None
    except _DAMAGED as error:
        reason = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise InputError(f"{path}: not a surrogate of this program ({reason}), allowed: {_WRITTEN}") from None


def _expansion(form: str, parts: Mapping[str, Array], inputs: int) -> Expansion:
    """Build an expansion over a number of inputs, shapes checked."""
    if form == "kernel":
        kernel = KernelExpansion(parts["centres"], parts["theta"], parts["weights"], float(parts["offset"]))
        if kernel.centres.shape == (len(kernel.weights), inputs) and kernel.theta.shape == (inputs,):
            return kernel
    elif form == "polynomial":
        degrees, coefficients = parts["degrees"], parts["coefficients"]
        if degrees.shape == (len(coefficients), inputs) and degrees.dtype.kind == "i":
            return PolynomialExpansion(degrees.astype(np.int64), coefficients)
    else:
        raise InputError(f"unknown form {form!r}")
    raise InputError("the shapes of its arrays do not belong together")
