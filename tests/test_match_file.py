"""Correspondence files: templates can be read, and every fault is one line with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from estimator.retargeting.correspondence import check_correspondence, common_correspondence, load_match, match_start
from humanoid.support.errors import InputError
from tests.builders import body_of

LIMB = 'left_thigh = {from = "left_hip", to = "left_knee"}'


def matched(folder: Path, text: str) -> Path:
    path = folder / "match.toml"
    path.write_text(text, encoding="utf-8")
    return path


def check_line(line: str, path: Path, message: str) -> None:
    """Errors start with the file and contain the text, up to quotes."""
    assert line.startswith(f"{path}: ")
    assert message in line.replace("'", "")
    assert "\n" not in line


@pytest.mark.parametrize("name", ["human34", "upper13", "arm8"])
def test_a_template_has_the_common_correspondence(tmp_path: Path, name: str) -> None:
    names = body_of(name).landmark_names
    path = matched(tmp_path, match_start(name, names))
    read, common = load_match(path), common_correspondence(names, names)
    assert read.limbs == common.limbs
    assert (read.places, read.scale, read.source) == ((), None, str(path))


def test_a_template_is_completed_by_its_comments(tmp_path: Path) -> None:
    """A subject without human limbs has all of them as comments, which become entries once filled in."""
    text = match_start("gripper", body_of("gripper").landmark_names)
    with pytest.raises(InputError, match="has no limbs and no places"):
        load_match(matched(tmp_path, text))
    text = text.replace('# "tip" = {source = "?"}', '"tip" = {source = "right_wrist", weight = 2}')
    place = load_match(matched(tmp_path, text.replace("# scale = 1.0", "scale = 0.5").replace("# [match]", "[match]")))
    assert (place.scale, len(place.places), place.places[0].subject) == (0.5, 1, "tip")
    assert (place.places[0].source, place.places[0].weight, place.places[0].subject_about) == ("right_wrist", 2.0, None)


def test_every_entry_is_read(tmp_path: Path) -> None:
    text = """
    [match]
    scale = 0.8
    [limbs]
    trunk = {from = ["a", "b"], to = "c", source_from = "left_hip", source_to = ["d", "e"], weight = 3}
    [places]
    hand = {source = "right_wrist", about = "base", source_about = "right_shoulder", weight = 0.5}
    """
    read = load_match(matched(tmp_path, text))
    (limb,), (place,) = read.limbs, read.places
    assert read.scale == 0.8
    assert (limb.subject_from, limb.subject_to) == (("a", "b"), ("c",))
    assert (limb.source_from, limb.source_to, limb.weight) == (("left_hip",), ("d", "e"), 3.0)
    assert (place.subject, place.subject_about) == ("hand", "base")
    assert (place.source, place.source_about, place.weight) == ("right_wrist", "right_shoulder", 0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"[limb]\n{LIMB}", "limb: unknown table"),
        (f"scale = 1.0\n[limbs]\n{LIMB}", "scale: unknown table"),
        ("[limbs]\nleft_thigh = 3", "[limbs] left_thigh: is not a table"),
        ('[limbs]\na = {from = "b", to = "c", wieght = 1}', "[limbs] a: unknown entry wieght"),
        ('[limbs]\na = {from = "b"}', "[limbs] a: to is not a landmark"),
        ('[limbs]\na = {from = [], to = "b"}', "[limbs] a: from is not a landmark"),
        ('[limbs]\na = {from = "b", to = "c", weight = 0}', "[limbs] a weight: is 0"),
        ('[limbs]\na = {from = "b", to = "c", weight = true}', "[limbs] a weight: is True"),
        ('[limbs]\na = {from = "b", to = "c", weight = nan}', "[limbs] a weight: is nan"),
        ("[match]\nscale = -1", "[match] scale: is -1"),
        ("[match]\nsize = 1", "[match]: unknown entry size"),
        ("[places]\na = {weight = 1.0}", "[places] a: is incomplete"),
        ('[places]\na = {source = "b", about = "c"}', "[places] a: is incomplete"),
        ('[places]\na = {source = "b", source_about = "c"}', "[places] a: is incomplete"),
        ('[places]\na = {source = ["b"]}', "[places] a: source is "),
        ("[limbs]\n[places]", "has no limbs and no places"),
        ("[limbs\n", "match.toml"),
        ("", "has no limbs and no places"),
    ],
)
def test_faults_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = matched(tmp_path, text)
    with pytest.raises(InputError) as raised:
        load_match(path)
    check_line(str(raised.value), path, message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[limbs]\na = {from = "left_hip", to = "knee"}', "limb a: the subject has no landmark knee"),
        ('[limbs]\na = {from = "left_hip", to = "left_knee", source_to = "k"}', "limb a: the source has no landmark k"),
        ('[places]\nx = {source = "left_wrist"}', "place x: the subject has no landmark x"),
        ('[places]\nleft_wrist = {source = "w"}', "place left_wrist: the source has no landmark w"),
        (
            '[places]\nleft_wrist = {source = "left_wrist", about = "neck", source_about = "n"}',
            "place left_wrist: the source has no landmark n",
        ),
    ],
)
def test_unknown_landmarks_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    names = body_of("human34").landmark_names
    path = matched(tmp_path, text)
    with pytest.raises(InputError) as raised:
        check_correspondence(load_match(path), names, names)
    check_line(str(raised.value), path, message)


def test_nothing_in_common_is_one_line() -> None:
    with pytest.raises(InputError, match="no limb is named alike; the subject has 'a, b', the source 'c'") as raised:
        common_correspondence(("b", "a"), ("c",))
    assert "--match SUBJECT" in str(raised.value)
