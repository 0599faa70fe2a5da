"""A second reading of a foreign URDF, by yourdfpy."""

from __future__ import annotations

import io

from humanoid.support.errors import InputError


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
