"""Pytrees come back exactly, altered files are refused, and a failed write leaves no trace."""

from __future__ import annotations

import dataclasses
import errno
import os
import resource
import stat
import zipfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from maxjax.core.files import atomic_write
from maxjax.core.serialization import load_metadata, load_pytree, read_npz, save_pytree


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Layer:
    kernel: jax.Array
    bias: jax.Array
    stride: int = dataclasses.field(metadata={"static": True})


def network(scale: float = 1.0) -> dict[str, object]:
    layers = [Layer(scale * jnp.arange(6.0).reshape(2, 3), jnp.full(3, scale), stride) for stride in (1, 2)]
    return {
        "layers": layers,
        "step": 7,
        "mean": np.float32(scale),
        "free": jnp.ones((2, 0, 3), bool),
        "none": None,
    }


def equal(a: object, b: object) -> bool:
    same = jax.tree.map(lambda x, y: type(x) is type(y) and np.array_equal(x, y), a, b)
    return all(jax.tree.leaves(same))


def test_round_trip_keeps_structure_types_and_values(tmp_path: Path) -> None:
    path = tmp_path / "network.npz"
    save_pytree(path, network(), metadata={"commit": "abc", "shape": (1, 2)})
    restored = load_pytree(path, network(scale=0.0))
    assert jax.tree.structure(restored) == jax.tree.structure(network())
    assert restored["layers"][1].stride == 2
    assert isinstance(restored["step"], int)
    assert isinstance(restored["layers"][0].kernel, jax.Array)
    np.testing.assert_array_equal(restored["layers"][0].kernel, network()["layers"][0].kernel)
    assert restored["free"].shape == (2, 0, 3)
    assert load_metadata(path) == {"commit": "abc", "shape": [1, 2]}
    assert os.listdir(tmp_path) == ["network.npz"]


@settings(max_examples=50, deadline=None)
@given(
    st.recursive(
        hnp.arrays(
            st.sampled_from([np.bool_, np.int8, np.int32, np.float32, np.float64, np.complex64]),
            hnp.array_shapes(min_dims=0),
        ),
        lambda inner: (
            st.lists(inner, min_size=1, max_size=3)
            | st.dictionaries(st.text(max_size=4), inner, min_size=1, max_size=3)
        ),
        max_leaves=5,
    )
)
def test_any_tree_comes_back_bit_for_bit(tmp_path_factory: pytest.TempPathFactory, tree: object) -> None:
    path = tmp_path_factory.mktemp("trees") / "tree.npz"
    save_pytree(path, tree)
    for before, after in zip(jax.tree.leaves(tree), jax.tree.leaves(load_pytree(path, tree)), strict=True):
        assert before.dtype == after.dtype
        assert before.shape == after.shape
        assert before.tobytes() == after.tobytes()


def test_plain_numpy_opens_the_file_and_names_its_leaves(tmp_path: Path) -> None:
    save_pytree(tmp_path / "a.npz", network())
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["tree['layers'][0].kernel"], np.arange(6.0).reshape(2, 3))


def test_equal_trees_give_equal_files(tmp_path: Path) -> None:
    save_pytree(tmp_path / "a.npz", network(), metadata={"seed": 1})
    save_pytree(tmp_path / "b.npz", network(), metadata={"seed": 1})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_loading_into_shapes_alone(tmp_path: Path) -> None:
    save_pytree(tmp_path / "a.npz", {"w": jnp.ones((2, 2))})
    like = jax.eval_shape(lambda: {"w": jnp.zeros((2, 2))})
    np.testing.assert_array_equal(load_pytree(tmp_path / "a.npz", like)["w"], np.ones((2, 2), np.float32))


def test_every_altered_bit_is_detected(tmp_path: Path) -> None:
    path = tmp_path / "tree.npz"
    tree = {"weight": np.linspace(0, 1, 40, dtype=np.float32), "step": np.int32(3)}
    save_pytree(path, tree, metadata={"seed": 1})
    intact = path.read_bytes()
    payload = intact.index(tree["weight"].tobytes()), len(tree["weight"].tobytes())
    detected = 0
    for bit in range(8 * len(intact)):
        if bit % 3 and not payload[0] <= bit // 8 < sum(payload):
            continue  # every bit of the numbers, a third of the rest
        altered = bytearray(intact)
        altered[bit // 8] ^= 1 << bit % 8
        path.write_bytes(altered)
        try:
            restored = load_pytree(path, tree)
        except ValueError:
            detected += 1
        else:  # dates and flags of the archive mean nothing to the contents
            assert equal(restored, tree)
            assert load_metadata(path) == {"seed": 1}
            assert not payload[0] <= bit // 8 < sum(payload)
    assert detected > 8 * payload[1]


@pytest.mark.parametrize("cut", [0, 1, 0.2, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(tmp_path: Path, cut: float) -> None:
    path = tmp_path / "tree.npz"
    save_pytree(path, network())
    content = path.read_bytes()
    path.write_bytes(content[: int(cut * len(content)) if cut < 1 else 1])
    with pytest.raises(ValueError, match=r"tree\.npz"):
        load_pytree(path, network())


def test_the_hash_alone_detects_a_consistent_forgery(tmp_path: Path) -> None:
    path = tmp_path / "tree.npz"
    save_pytree(path, {"w": np.arange(3.0)}, metadata={"seed": 1})
    arrays = read_npz(path)
    for forged in (arrays | {"tree['w']": np.arange(1.0, 4.0)}, arrays | {"tree['v']": np.arange(3.0)}):
        np.savez(path, **forged)  # valid archive, valid checksums
        with pytest.raises(ValueError, match="SHA-256"):
            load_pytree(path, {"w": np.arange(3.0)})
    header = arrays["header"].tobytes().replace(b'"seed": 1', b'"seed": 2')
    np.savez(path, **(arrays | {"header": np.frombuffer(header, np.uint8)}))
    with pytest.raises(ValueError, match="SHA-256"):
        load_metadata(path)


@pytest.mark.parametrize(
    ("like", "message"),
    [
        ({"w": np.zeros((2, 3))}, r"tree\['w'\]: expected float64\[2, 3\], given float32\[2, 3\]"),
        ({"w": np.zeros((3, 2), np.float32)}, r"expected float32\[3, 2\], given float32\[2, 3\]"),
        ({"v": np.zeros((2, 3), np.float32)}, r"lacks tree\['v'\], has unexpected tree\['w'\]"),
        ([np.zeros((2, 3), np.float32)], r"lacks tree\[0\]"),
    ],
)
def test_another_structure_is_refused_with_expected_and_given(tmp_path: Path, like: object, message: str) -> None:
    save_pytree(tmp_path / "a.npz", {"w": np.zeros((2, 3), np.float32)})
    with pytest.raises(ValueError, match=message):
        load_pytree(tmp_path / "a.npz", like)


@pytest.mark.parametrize(
    "leaf",
    ["text", np.array([object()]), jnp.ones(2, jnp.bfloat16), jax.random.key(0)],
    ids=["text", "object", "bfloat16", "key"],
)
def test_leaves_that_are_not_plain_numbers_are_refused(tmp_path: Path, leaf: object) -> None:
    with pytest.raises(ValueError, match=r"tree\['a'\]: expected"):
        save_pytree(tmp_path / "a.npz", {"a": leaf})
    with pytest.raises(ValueError, match="JSON"):
        save_pytree(tmp_path / "a.npz", {"a": 1.0}, metadata={"a": object()})
    with pytest.raises(ValueError, match="without leaves"):
        save_pytree(tmp_path / "a.npz", {})
    assert not os.listdir(tmp_path)


def test_foreign_and_missing_files_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "foreign.npz", a=np.ones(3))
    (tmp_path / "text.npz").write_text("not an archive")
    for path, message in (
        (tmp_path / "foreign.npz", "save_pytree"),
        (tmp_path / "text.npz", "archive"),
        (tmp_path / "absent.npz", "cannot be read"),
        (tmp_path, "cannot be read"),
    ):
        with pytest.raises(ValueError, match=message):
            load_pytree(path, {"a": np.ones(3)})


def test_pickles_are_never_opened(tmp_path: Path) -> None:
    np.savez(tmp_path / "pickle.npz", a=np.array([{"x": 1}], dtype=object))
    with pytest.raises(ValueError, match="pickled objects"):
        read_npz(tmp_path / "pickle.npz")


def test_archives_that_lie_about_their_size_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.npz"
    np.savez_compressed(bomb, a=np.zeros(2_000_000, np.uint8))
    with pytest.raises(ValueError, match="at most 1000000"):
        read_npz(bomb, max_bytes=1_000_000)
    claims = tmp_path / "claims.npz"
    with zipfile.ZipFile(claims, "w") as archive, archive.open("a.npy", "w") as entry:
        np.lib.format.write_array_header_1_0(entry, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)})
    with pytest.raises(ValueError, match="damaged"):
        read_npz(claims)


def test_fortran_order_and_empty_arrays_are_read(tmp_path: Path) -> None:
    arrays = {
        "f": np.asfortranarray(np.arange(6).reshape(2, 3)),
        "empty": np.zeros((0, 3)),
        "scalar": np.float32(2),
    }
    np.savez(tmp_path / "a.npz", **arrays)
    for name, array in read_npz(tmp_path / "a.npz").items():
        np.testing.assert_array_equal(array, arrays[name])


def test_atomic_write_creates_and_replaces_with_the_users_permissions(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    atomic_write(path, "λ\n")
    atomic_write(path, b"new")
    assert path.read_bytes() == b"new"
    plain = tmp_path / "plain"
    plain.write_text("")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    path = tmp_path / "tree.npz"
    save_pytree(path, {"w": 1.0})

    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, call, fail)
    with pytest.raises(OSError, match="No space"):
        save_pytree(path, {"w": 2.0})
    monkeypatch.undo()
    assert os.listdir(tmp_path) == ["tree.npz"]
    assert load_pytree(path, {"w": 0.0}) == {"w": 1.0}


def test_a_write_cut_short_by_the_system_leaves_nothing(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(OSError, match="large"):
            save_pytree(tmp_path / "big.npz", {"w": np.zeros(100_000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not os.listdir(tmp_path)
