# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept between processes.

numba looks only at the file of the cached function itself: after a change of a function that it calls in another file it
would go on using the old code. So the folder's name holds a hash of all that compiled functions can see. It lies beside the sources
if that is writable, else in the user's cache.

Whoever compiles takes `njit` from here, so that the folder is set before; what compiles nothing needs no numba at all.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, Protocol, TypeVar

import numba

if TYPE_CHECKING:  # numba has no types: say what its decorator keeps of a function
    P = ParamSpec("P")
    Result_co = TypeVar("Result_co", covariant=True)

    class Compiled(Protocol[P, Result_co]):
        """A compiled function, and the Python function that it was made from."""

        @property
        def py_func(self) -> Callable[P, Result_co]:
            """The function, not compiled."""

        def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Result_co:
            """Call the compiled function."""

    class Compiler(Protocol):
        """A decorator that compiles."""

        def __call__(self, function: Callable[P, Result_co]) -> Compiled[P, Result_co]:
            """Compile a function at its first call."""

    def njit(*, cache: bool = False, nogil: bool = False, error_model: str = "python") -> Compiler:
        """`numba.njit`, with the options used here."""
else:
    from numba import njit  # noqa: F401 (whoever compiles takes it from here)


PACKAGE = Path(__file__).parent.parent
KERNEL_SOURCES = (
    "dynamics/jit_cache.py",
    "dynamics/simd.py",
    "dynamics/footing.py",
    "dynamics/vfife.py",
    "rolling/batch.py",
    "rolling/quasi_static.py",
    "rolling/roll_monitor.py",
    "structure/topology.py",
)
"""The functions that `rolling.warm_up` compiles, and whatever compiled functions use of other files."""


def hash_of_sources(paths: Iterable[Path]) -> str:
    """Identifies sources of this package: sha256 of their names and bytes, 16 hex digits."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.relative_to(PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def use_own_folder() -> Path:
    """Point numba at the folder for exactly these kernels; must run before anything is compiled.

    A folder given by the user (NUMBA_CACHE_DIR) is the parent then.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        parent = Path(given)
    elif os.access(PACKAGE, os.W_OK):
        parent = PACKAGE / "__pycache__"
    else:
        parent = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sixstrut"
    folder = parent / f"kernels-{hash_of_sources(PACKAGE / name for name in KERNEL_SOURCES)}"
    config: Any = numba.config
    config.CACHE_DIR = str(folder)
    return folder


use_own_folder()
