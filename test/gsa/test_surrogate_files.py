"""Surrogates in files: bit for bit, without pickle, and nothing else is taken for one.

Source: the surrogate that was written; files of other kinds, cut and changed ones (hypothesis).
"""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sobol_functions import FUNCTIONS

from tbm_gsa import fit_surrogate
from tbm_gsa.sensitivity.surrogates import load_surrogate
from tbm_gsa.sensitivity.surrogates.files import save_surrogate


@pytest.mark.parametrize("method", ["krg", "rbf", "svr", "prs"])
@pytest.mark.parametrize("transform", ["none", "log"])
def test_a_surrogate_comes_back_bit_for_bit(tmp_path, method, transform):
    function = FUNCTIONS["borehole"]
    X, y = function.samples(60, 1)
    model = fit_surrogate(method, X, y, bounds=function.bounds, transform=transform)
    save_surrogate(model, tmp_path / "model.npz")
    again = load_surrogate(tmp_path / "model.npz")
    points, _ = function.samples(50, 9)
    np.testing.assert_array_equal(again.predict(points), model.predict(points))
    assert (again.method, again.settings, again.seed) == (model.method, model.settings, model.seed)
    assert again.samples.transform == transform
    with np.load(tmp_path / "model.npz", allow_pickle=False) as arrays:  # any numpy reads it, without pickle
        np.testing.assert_array_equal(arrays["X"], X)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    function = FUNCTIONS["ishigami"]
    X, y = function.samples(30, 1)
    path = tmp_path_factory.mktemp("surrogate") / "model.npz"
    save_surrogate(fit_surrogate("krg", X, y, bounds=function.bounds), path)
    return path.read_bytes()


@settings(max_examples=60)
@given(cut=st.integers(0, 10_000), place=st.integers(0, 10_000), value=st.integers(0, 255))
def test_damaged_files_are_refused_in_one_line(tmp_path_factory, written, cut, place, value):
    path = tmp_path_factory.mktemp("damaged") / "model.npz"
    data = bytearray(written[: max(1, len(written) - cut % len(written))])
    data[place % len(data)] = value
    path.write_bytes(bytes(data))
    try:
        load_surrogate(path)
    except ValueError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)


def test_files_of_others_are_refused(tmp_path):
    for name, content in (("text.npz", b"hello"), ("pickle.npz", pickle.dumps({"a": 1}))):
        (tmp_path / name).write_bytes(content)
    np.savez(tmp_path / "arrays.npz", a=np.zeros(3))
    np.savez(tmp_path / "objects.npz", header=np.array([{"a": 1}], dtype=object), allow_pickle=True)
    np.save(tmp_path / "one.npz.npy", np.zeros(3))
    for name in ("text.npz", "pickle.npz", "arrays.npz", "objects.npz", "one.npz.npy"):
        with pytest.raises(
            ValueError, match=f"{name}: not a surrogate of this program .*, allowed: a file that `save_surrogate`"
        ):
            load_surrogate(tmp_path / name)
    with pytest.raises(ValueError, match=r"nowhere\.npz: cannot be read"):
        load_surrogate(tmp_path / "nowhere.npz")
