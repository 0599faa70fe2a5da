"""An index of examples: poses of a subject, found by what they look like; one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays, check_configurations
from estimator.data.formats.npz import read_headed, write_headed
from estimator.search.examples.hashing import KEY_BITS, TABLES, Bits, HashTables, Neighbours
from estimator.vision.person_view import ViewFrame, bin_count
from humanoid.kinematics.body import ROOT_Q, Body
from humanoid.support.errors import InputError

FORMAT = 2  # another whenever equal pictures are described otherwise
REMEDY = "train one: kinemode train-index SUBJECT --out FILE"
_FIELDS = {
    "q": Field("f", ("N", "nq")), "codes": Field("u", ("N", "W")), "feature": Field("i", ("M",)),
    "threshold": Field("u", ("M",)), "true_rate": Field("f", ("M",)), "false_rate": Field("f", ("M",)),
    "keys": Field("i", ("tables", "key_bits")), "header": Field("U"),
}  # fmt: skip


@dataclass(frozen=True)
class IndexRecipe:
    """The recipe of an index; equal recipes give equal indices.

    examples: how many. headings [degrees]: range of the body's heading about facing the camera. legs: whether they move
    too. elevation [degrees]: angle by which the camera looks down. variants: bodies of other lengths and girth in the
    pictures. pairs: of either kind that the bits are learned from. tables, key_bits: of the hashing. seed: of all that
    is random.
    """

    examples: int = 60_000
    headings: float = 360.0
    legs: bool = False
    elevation: float = 8.0
    variants: int = 24
    pairs: int = 4000
    tables: int = TABLES
    key_bits: int = KEY_BITS
    seed: int = 0


@dataclass(frozen=True, eq=False)
class ExampleIndex:
    """Examples, N, of a subject with coordinates `q_names` (nq).

    recipe: what it is made of. side [m]: of the square around a person that is described. q (N, nq): the poses, a free
    root in the frame of the view (`ViewFrame`). bits: of a description. tables: the examples' bits, in buckets.
    """

    recipe: IndexRecipe
    q_names: tuple[str, ...]
    side: float
    q: np.ndarray
    bits: Bits
    tables: HashTables

    def nearest(self, description: np.ndarray, count: int) -> Neighbours:
        """The `count` examples that look most like a description (bins,)."""
        return self.tables.nearest(self.bits.of(description[None])[0], count)

    def distances(self, description: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """In how many bits some examples (K,) differ from a description (bins,), (K,) int64."""
        return self.tables.distances(self.bits.of(description[None])[0], numbers)

    def poses(self, numbers: np.ndarray, frame: ViewFrame) -> np.ndarray:
        """Some examples as poses (K, nq) in the world, of a person who is seen in `frame`."""
        q = self.q[numbers].astype(np.float64)
        if self.q_names[: ROOT_Q.stop][-1:] == ("root_qw",):
            world_view = pin.SE3(frame.R_world_view, frame.origin)
            for pose in q:
                root = pose[ROOT_Q]
                root[3:] /= np.linalg.norm(root[3:])  # of single precision
                pose[ROOT_Q] = pin.SE3ToXYZQUAT(world_view * pin.XYZQUATToSE3(root))
        return q

    def save(self, path: str | Path) -> None:
        """Write it to one file; raises InputError where it is not writable."""
        header = {"format": FORMAT, "recipe": asdict(self.recipe), "q_names": list(self.q_names), "side": self.side}
        arrays = {
            "q": self.q.astype(np.float32), "codes": self.tables.codes, "feature": self.bits.feature,
            "threshold": self.bits.threshold, "true_rate": self.bits.true_rate, "false_rate": self.bits.false_rate,
            "keys": self.tables.chosen.astype(np.int32),
        }  # fmt: skip
        write_headed(Path(path), header, arrays)


def load_index(path: str | Path, body: Body) -> ExampleIndex:
    """An index for a body.

    Raises
    ------
    InputError: the file cannot be read, is damaged, is not an index or one of another version, or one of another
    subject.
    """
    arrays, recipe, side = _checked(Path(path), body)
    bits = Bits(
        arrays["feature"].astype(np.int32), arrays["threshold"].astype(np.uint16), arrays["true_rate"],
        arrays["false_rate"],
    )  # fmt: skip
    tables = HashTables(arrays["codes"].astype(np.uint64), arrays["keys"].astype(np.int64))
    return ExampleIndex(recipe, body.q_names, side, arrays["q"], bits, tables)


def check_index(path: str | Path, body: Body) -> None:
    """Raise InputError where `load_index` would; the tables, which take most of its time, are not made."""
    _checked(Path(path), body)


def _checked(path: Path, body: Body) -> tuple[dict[str, np.ndarray], IndexRecipe, float]:
    """The arrays of a file, its recipe and side."""
    needed = ("codes", "q", "feature", "keys")
    arrays, header = read_headed(path, "an index of examples", FORMAT, needed, REMEDY)
    if not isinstance(header.get("q_names"), list):
        raise InputError(path, "is damaged: names are needed", place="q_names", remedy=REMEDY)
    names = tuple(str(name) for name in header["q_names"])
    if names != body.q_names:
        problem = f"is of another subject than {body.subject.source}: its coordinates are {', '.join(names[:9])}, ..."
        raise InputError(path, problem, remedy=REMEDY)
    try:
        check_arrays(arrays, _FIELDS, {"nq": body.nq, "N": len(arrays["q"]), "M": len(arrays["feature"])})
        recipe = IndexRecipe(**header["recipe"])
        side = float(header["side"])
        _check(arrays, body, side)
    except (DamageError, TypeError, ValueError, KeyError) as error:
        raise InputError(path, f"is damaged: {error}", remedy=REMEDY) from None
    return arrays, recipe, side


def _check(arrays: Mapping[str, np.ndarray], body: Body, side: float) -> None:
    """Check that valid parts are consistent with each other; raises DamageError."""
    bits = len(arrays["feature"])
    if not len(arrays["q"]) or not bits or arrays["codes"].shape[1] != -(-bits // 64):
        raise DamageError(f"codes of {arrays['codes'].shape[1]} words for {bits} bits")
    for name, most in (("feature", bin_count()), ("keys", bits)):
        if arrays[name].min() < 0 or arrays[name].max() >= most:
            raise DamageError(f"{name} has numbers beyond {most}")
    if not 0.1 < side < 100.0:
        raise DamageError(f"a side of {side:g} m")
    check_configurations(body, arrays["q"].astype(np.float64), "q")
