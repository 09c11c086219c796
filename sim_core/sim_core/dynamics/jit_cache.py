# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept between processes.

numba looks only at the file of the cached function itself: after a change of a function that it calls in another file it
would go on using the old code. So the folder's name holds a hash of all that compiled functions can see. It lies beside the sources
if that is writable, else in the user's cache, else in a temporary folder. Each file ends with its checksum: numba believes
whatever it finds, and a process dies of a damaged one.

Whoever compiles takes `njit` from here, so that the folder is set before; what compiles nothing needs no numba at all.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, Protocol, TypeVar

import numba
from numba.core import caching

from sim_core.files.places import cache_folder

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
    "dynamics/actuators.py",
    "dynamics/jit_cache.py",
    "dynamics/simd.py",
    "dynamics/footing.py",
    "dynamics/vfife.py",
    "rolling/batch.py",
    "rolling/quasi_static.py",
    "rolling/roll_monitor.py",
    "sensing/face_filter.py",
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
    name = f"kernels-{hash_of_sources(PACKAGE / name for name in KERNEL_SOURCES)}"
    given = os.environ.get("NUMBA_CACHE_DIR")
    folder = cache_folder(name, given and Path(given) / name, PACKAGE / "__pycache__" / name)
    config: Any = numba.config
    config.CACHE_DIR = str(folder)
    return folder


_Files: Any = caching.IndexDataCacheFile


class CheckedFiles(_Files):  # type: ignore[misc]
    """numba's files of one function, with checksums: what is damaged counts as not there, and is compiled and written again."""

    told = False

    def save(self, key: Any, data: Any) -> None:
        """Keep compiled code; where it cannot be written (a full disk) this process goes on without."""
        with suppress(OSError):
            super().save(key, data)

    def _load_index(self) -> dict[Any, str]:
        return dict(super()._load_index()) if self._is_well(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        if not self._is_well(self._data_path(name)):
            raise OSError(f"{name} is damaged")  # numba compiles it again
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BytesIO]:
        with super()._open_for_write(filepath) as file, BytesIO() as whole:
            yield whole
            data = whole.getvalue()
            file.write(data + hashlib.sha256(data).digest())

    def _is_well(self, path: str) -> bool:
        try:
            data = Path(path).read_bytes()
        except FileNotFoundError:
            return False
        except OSError:
            data = b""
        if hashlib.sha256(data[:-32]).digest() == data[-32:]:
            return True
        if not CheckedFiles.told:
            CheckedFiles.told = True
            print(f"{path} is damaged: compiling it again", file=sys.stderr)
        return False


caching.IndexDataCacheFile = CheckedFiles  # type: ignore[misc]
use_own_folder()
