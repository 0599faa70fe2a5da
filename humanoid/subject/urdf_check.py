"""Checks of a URDF before Pinocchio reads it: every fault is an InputError with element, line and remedy."""

from __future__ import annotations

import io
import math
import xml.etree.ElementTree as ET

from humanoid.subject.urdf_document import PLAUSIBLE, Document, elements
from humanoid.subject.urdf_mimic import check_mimic
from humanoid.support.errors import InputError, nearest

MOVABLE = ("revolute", "continuous", "prismatic", "planar", "floating")
JOINT_TYPES = (*MOVABLE, "fixed")
MAX_LINKS = 2000
RESERVED = ("universe", "root_joint")  # Pinocchio's own names

_SIZES = {
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
}


def check_urdf(document: Document) -> None:
    """Check a whole URDF: names, numbers, joints, shapes, and that links and joints form one tree.

    Raises
    ------
    InputError: the first fault found.
    """
    root = document.root
    if root.tag != "robot":
        raise document.fault(root, "is not a URDF: the outermost element is not <robot>", 'write <robot name="...">')
    for child in elements(root):
        if child.tag.startswith("xacro:"):
            raise document.fault(child, "is xacro, not URDF", "expand it first: xacro file.urdf.xacro > file.urdf")
    document.attribute(root, "name")
    links, joints = _named(document, "link"), _named(document, "joint")
    if not links:
        raise document.fault(root, "has no <link>", 'add at least one <link name="..."/>')
    if len(links) > MAX_LINKS:
        raise document.fault(root, f"has {len(links)} links, more than {MAX_LINKS}", "split the model")
    for link in links.values():
        _check_link(document, link)
    for joint in joints.values():
        _check_joint(document, joint, links, joints)
    _check_tree(document, links, joints)


def _named(document: Document, tag: str) -> dict[str, ET.Element]:
    by_name: dict[str, ET.Element] = {}
    for element in elements(document.root, tag):
        name = element.get("name", "")
        if not name.strip():
            raise document.fault(element, f"a <{tag}> has no name", 'add name="..."')
        if name in by_name:
            raise document.fault(element, f"there are two <{tag}> named {name!r}", "rename one")
        if name in RESERVED and (tag == "joint" or name == "universe"):
            raise document.fault(element, f"the name {name!r} is reserved by Pinocchio", "rename it")
        by_name[name] = element
    return by_name


def _only(document: Document, parent: ET.Element, tag: str) -> ET.Element | None:
    same = list(elements(parent, tag))
    if len(same) > 1:
        raise document.fault(same[1], f"a second <{tag}>", "keep one")
    return same[0] if same else None


def _check_origin(document: Document, parent: ET.Element) -> None:
    origin = _only(document, parent, "origin")
    if origin is not None:
        document.triple(origin, "xyz")
        document.triple(origin, "rpy")


def _check_link(document: Document, link: ET.Element) -> None:
    inertial = _only(document, link, "inertial")
    if inertial is not None:
        _check_inertial(document, inertial)
    for kind in ("visual", "collision"):
        for element in elements(link, kind):
            _check_origin(document, element)
            _check_geometry(document, element)


def _check_inertial(document: Document, inertial: ET.Element) -> None:
    _check_origin(document, inertial)
    mass, inertia = _only(document, inertial, "mass"), _only(document, inertial, "inertia")
    if mass is None or inertia is None:
        raise document.fault(inertial, "needs both <mass> and <inertia>", "add them, or leave <inertial> out")
    if document.number(mass, "value") < 0.0:
        raise document.fault(mass, "the mass is negative", "give it in kilograms, not below 0")
    for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        document.number(inertia, key)


def _check_geometry(document: Document, parent: ET.Element) -> None:
    geometry = _only(document, parent, "geometry")
    shapes = [] if geometry is None else list(elements(geometry))
    valid = ", ".join([*_SIZES, "mesh"])
    if geometry is None or len(shapes) != 1:
        raise document.fault(parent, "needs one <geometry> with one shape", f"shapes: {valid}")
    shape = shapes[0]
    if shape.tag == "mesh":
        document.attribute(shape, "filename")
        if 0.0 in document.triple(shape, "scale", "1 1 1"):
            raise document.fault(shape, "a mesh scale is zero", "give three factors other than 0")
    elif shape.tag not in _SIZES:
        raise document.fault(shape, "is an unknown shape", f"shapes: {valid}")
    for key, count in _SIZES.get(shape.tag, ()):
        if not all(0.0 < v <= PLAUSIBLE for v in document.numbers(shape, key, count)):
            raise document.fault(shape, f"{key}={shape.get(key)!r} is not positive", "give sizes in metres, above 0")


def _check_joint(
    document: Document, joint: ET.Element, links: dict[str, ET.Element], joints: dict[str, ET.Element]
) -> None:
    kind = document.attribute(joint, "type")
    if kind not in JOINT_TYPES:
        raise document.fault(joint, f"unknown joint type {kind!r}", "types: " + ", ".join(JOINT_TYPES))
    ends = [_link_named(document, joint, tag, links) for tag in ("parent", "child")]
    if ends[0] == ends[1]:
        raise document.fault(joint, f"parent and child are the same link {ends[0]!r}", "join two links")
    _check_origin(document, joint)
    axis = _only(document, joint, "axis")
    if axis is not None and kind not in ("fixed", "floating"):
        xyz = document.triple(axis, "xyz", None)
        if math.hypot(*xyz) < 1e-6:
            raise document.fault(axis, "the axis has zero length", 'give a direction such as xyz="0 0 1"')
    if kind == "planar":
        _check_plane(document, joint, axis)
    limit = _only(document, joint, "limit")
    if limit is not None:
        for key in ("lower", "upper", "effort", "velocity"):
            document.number(limit, key, "0")
    if kind in ("revolute", "prismatic"):
        _check_limit(document, joint, limit)
    mimic = _only(document, joint, "mimic")
    if mimic is not None:
        check_mimic(document, joint, mimic, joints)


def _check_plane(document: Document, joint: ET.Element, axis: ET.Element | None) -> None:
    """Refuse planes that Pinocchio does not support: it has only that of x and y, and ignores the axis."""
    x, y, z = (1.0, 0.0, 0.0) if axis is None else document.triple(axis, "xyz", None)
    if math.hypot(x, y) > 1e-6 * z:
        problem = f"the normal of its plane is {x:g} {y:g} {z:g}" + (", as it has no <axis>" if axis is None else "")
        remedy = 'only planes of x and y are posed: write <axis xyz="0 0 1"/>, and turn the <origin> if need be'
        raise document.fault(joint if axis is None else axis, problem, remedy)


def _link_named(document: Document, joint: ET.Element, tag: str, links: dict[str, ET.Element]) -> str:
    element = _only(document, joint, tag)
    if element is None:
        raise document.fault(joint, f"has no <{tag}>", f'add <{tag} link="..."/>')
    name = element.get("link", "")
    if name not in links:
        raise document.fault(element, f"there is no link {name!r}", nearest(name, links, "links"))
    return name


def _check_limit(document: Document, joint: ET.Element, limit: ET.Element | None) -> None:
    unit = "rad" if joint.get("type") == "revolute" else "m"
    example = f'<limit lower="-1" upper="1" effort="100" velocity="5"/> ({unit})'
    if limit is None or limit.get("lower") is None or limit.get("upper") is None:
        what = "has no <limit>" if limit is None else "its <limit> lacks lower or upper"
        more = ', or make it type="continuous"' if unit == "rad" else ""
        raise document.fault(joint if limit is None else limit, what, f"add {example}{more}")
    lower, upper = document.number(limit, "lower"), document.number(limit, "upper")
    if lower > upper:
        raise document.fault(limit, f"lower {lower:g} is above upper {upper:g}", "exchange them")


def _check_tree(document: Document, links: dict[str, ET.Element], joints: dict[str, ET.Element]) -> None:
    children: dict[str, list[str]] = {name: [] for name in links}
    parent_joint: dict[str, str] = {}
    for name, joint in joints.items():
        parent, child = ends_of(joint)
        if child in parent_joint:
            raise document.fault(
                joint, f"link {child!r} already hangs on joint {parent_joint[child]!r}", "a URDF is a tree: drop one"
            )
        parent_joint[child] = name
        children[parent].append(child)
    roots = [name for name in links if name not in parent_joint]
    if len(roots) > 1:
        names = ", ".join(map(repr, roots[:10]))
        raise document.fault(
            document.root, f"has {len(roots)} roots: {names}", "join them to one root link by joints of type fixed"
        )
    reached, rest = set(roots), list(roots)
    while rest:
        new = children[rest.pop()]
        reached.update(new)
        rest += new
    loose = [name for name in links if name not in reached]
    if loose:
        names = ", ".join(map(repr, loose[:10]))
        joint = joints[parent_joint[loose[0]]]
        raise document.fault(joint, f"the joints of {names} form a cycle", "cut it at one joint")


def ends_of(joint: ET.Element) -> tuple[str, str]:
    """Parent and child link of a checked joint."""
    ends = {e.tag: e.get("link", "") for e in elements(joint) if e.tag in ("parent", "child")}
    return ends["parent"], ends["child"]


def root_link(document: Document) -> str:
    """Name of the root of a checked URDF."""
    children = {ends_of(joint)[1] for joint in elements(document.root, "joint")}
    return next(link.attrib["name"] for link in elements(document.root, "link") if link.attrib["name"] not in children)


def natural_base(document: Document) -> str:
    """Base of a checked URDF that names none: "free" if several movable joints leave the root, else "fixed".

    A serial arm is bolted down at its root; a body whose limbs leave its root moves in space. Links fixed to the root
    count with it. A root link named "world" is the ground, and what cannot move otherwise is a free rigid object.
    """
    root = root_link(document)
    if root == "world":
        return "fixed"
    below: dict[str, list[tuple[str, bool]]] = {}
    for joint in elements(document.root, "joint"):
        parent, child = ends_of(joint)
        below.setdefault(parent, []).append((child, joint.get("type") == "fixed"))
    rest, leaving = [root], 0
    while rest:
        for child, rigid in below.get(rest.pop(), ()):
            if rigid:
                rest.append(child)
            else:
                leaving += 1
    return "fixed" if leaving == 1 else "free"


def check_with_yourdfpy(plain_urdf: str, source: str) -> None:
    """Let yourdfpy parse and validate what Pinocchio will get, without its meshes.

    Raises
    ------
    InputError: yourdfpy refuses it.
    """
    import yourdfpy  # slow to import, and built-in subjects do without

    remedy = "see the URDF format"
    try:
        robot = yourdfpy.URDF.load(io.BytesIO(plain_urdf.encode("utf-8")), build_scene_graph=False, load_meshes=False)
        sound = robot.validate()
    except Exception as error:  # its parsing lets errors of any kind through
        problem = f"yourdfpy cannot read it ({type(error).__name__}: {' '.join(str(error).split())})"
        raise InputError(source, problem, remedy=remedy) from error
    if not sound:
        faults = "; ".join(dict.fromkeys(str(e) for e in robot.errors))
        raise InputError(source, f"yourdfpy finds: {faults}", remedy=remedy)
