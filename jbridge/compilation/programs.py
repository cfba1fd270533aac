"""Programs kept from one run to the next before they are compiled.

JAX's compilation cache keeps what the compiler made of a program, but finds it only after Python has traced and lowered
the program again, which for the rollouts of a diagnosis takes longer than running them. Here the lowered program is
kept, too (`jax.export`), under a name made of everything that it depends on: this package's sources, the versions of
what traces and lowers them, the structure of what is held constant, and the shapes of the arguments. It is data for the
compiler, not code for Python.
"""

import contextlib
import ctypes
import functools
import gc
import hashlib
import os
import shutil
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Hashable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.export

_DAYS_KEPT = 30
"""Folders of versions of the sources that have not run for so long are removed."""
_LARGE = 1.25 * 2**30
"""Resident memory [byte] from which programs that may not be needed again are dropped; a round of a search with a fine
map of friction takes another half of that."""
_GROWN = 0.5 * 2**30
"""By how much a process must have grown since it last dropped programs [byte]."""
_without = 0.0
"""Memory after that [byte]."""
_OFTEN: dict[str, bool | int] = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}
"""What the compiler is asked for on a processor. Measured on the loops of a fit: code as fast as by its own choice (the
second level, and emitters of fused operations that go through another compiler first), made in half the time."""
_ONCE = _OFTEN | {"xla_backend_optimization_level": 0}
"""The same where a program runs a few times only: made in a quarter of the time, one to three times slower."""
_DIGEST = hashlib.sha256().digest_size
_CHANGE_TRACES = ("jax_enable_x64", "jax_default_matmul_precision", "jax_debug_nans")
_folder: Path | None = None
_all: "weakref.WeakSet[Program]" = weakref.WeakSet()


def keep_in(folder: Path | None) -> None:
    """Keeps programs in a folder from now on; None keeps none.

    Raises:
        OSError: the folder is neither there nor can it be made.
    """
    global _folder
    _folder = None
    if folder is None:
        return
    own = folder / _version()
    own.mkdir(parents=True, exist_ok=True)
    _folder = own
    for other in folder.iterdir():
        # Another process may tidy up at the same time, and a folder that can only be read serves as well.
        with contextlib.suppress(OSError):
            if other == own:
                os.utime(own)
            elif other.stat().st_mtime < time.time() - _DAYS_KEPT * 86400:
                shutil.rmtree(other, ignore_errors=True)


def forget() -> None:
    """Drops what was compiled, and gives its memory back; whoever needs a program again finds it in the folder.

    A program of a rollout takes 50 MB or more, and a diagnosis makes dozens. Without a folder they are compiled anew,
    and so is whatever else of JAX this process had compiled.
    """
    for program in list(_all):
        program.forget()
    jax.clear_caches()
    gc.collect()
    if sys.platform == "linux":
        # Only glibc keeps what was freed and can be asked for it.
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL("libc.so.6").malloc_trim(0)


def forget_if_large() -> None:
    """`forget`, if this process has grown large and finds its programs again in the folder."""
    global _without
    if _folder is None:
        return
    # What stays large without programs would not get smaller.
    if _resident() > _LARGE and _resident() > _without + _GROWN:
        forget()
        _without = _resident()


def _resident() -> float:
    """Memory [byte] that this process holds, as far as the system says."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return 0.0


_seconds = 0.0
_counting = threading.Lock()


def seconds() -> float:
    """How long it took to make the programs that this process has kept so far, each with its first run [s]."""
    return _seconds


def _spent(some: float) -> None:
    global _seconds
    with _counting:
        _seconds += some


T = TypeVar("T", bound=type)


def returned(cls: T) -> T:
    """For a `NamedTuple` that a kept program returns: its name goes into the file."""
    jax.export.register_namedtuple_serialization(cls, serialized_name=f"{cls.__module__}.{cls.__qualname__}")
    return cls


def kept(*, static: tuple[int, ...] = (), once: bool = False) -> Callable[[Callable], "Program"]:
    """`jax.jit` for a function of arrays that remembers its programs, see `keep_in`.

    Args:
        static: places of arguments that are no arrays. Equal ones make the same program, and their `repr` says, in
            words that are the same in every process, all that it depends on.
        once: whether a program runs but a few times, so that it matters more how soon it is made than how fast it is.
    """
    return functools.partial(Program, static=static, once=once)


class Program:
    """A compiled function, traced once for all runs. May be called inside another one, which then takes it in."""

    def __init__(self, function: Callable, static: tuple[int, ...], once: bool = False):
        functools.update_wrapper(self, function)
        self._name: str = function.__name__
        self._function = function
        self._static = static
        self._once = once
        self._within = jax.jit(function, static_argnums=static)
        """Inside another program, which is compiled as that one is."""
        self._jit: Callable | None = None
        self._loaded: dict[Hashable, Callable] = {}
        self._locks: dict[Hashable, threading.Lock] = {}
        _all.add(self)

    def forget(self) -> None:
        """Drops what was loaded; a call that is under way holds what it needs."""
        self._loaded.clear()
        self._locks.clear()

    def __call__(self, *args: Any) -> Any:
        folder = _folder
        given = [arg for i, arg in enumerate(args) if i not in self._static]
        leaves, treedef = jax.tree.flatten(given)
        plain = any(isinstance(leaf, jax.core.Tracer) or not hasattr(leaf, "shape") for leaf in leaves)
        if plain:
            return self._within(*args)
        if folder is None:
            if self._jit is None:
                self._jit = jax.jit(self._function, static_argnums=self._static, compiler_options=_asked(self._once))
            return self._jit(*args)
        constants = tuple(args[i] for i in self._static)
        kinds = tuple((leaf.shape, str(leaf.dtype), bool(getattr(leaf, "weak_type", False))) for leaf in leaves)
        key = (folder, constants, treedef, kinds, _settings())
        call = self._loaded.get(key)
        if call is None:
            with self._locks.setdefault(key, threading.Lock()):
                call = self._loaded.get(key)
                if call is None:
                    begun = time.monotonic()
                    call = self._load(folder, constants, treedef, kinds, leaves)
                    out = call(*leaves)
                    self._loaded[key] = call
                    _spent(time.monotonic() - begun)
                    return out
        return call(*leaves)

    def _load(self, folder: Path, constants: tuple, treedef: Any, kinds: tuple, leaves: list) -> Callable:
        def flat(*leaves: Any) -> Any:
            args = list(jax.tree.unflatten(treedef, leaves))
            for i, constant in sorted(zip(self._static, constants, strict=True)):
                args.insert(i, constant)
            return self._function(*args)

        flat.__name__ = self._name
        traced = jax.jit(flat, compiler_options=_asked(self._once))
        structures = [treedef, *(c.treedef for c in jax.tree.leaves(constants) if hasattr(c, "treedef"))]
        if not all(_is_ours(structure) for structure in structures):
            return traced  # of sources elsewhere a name says nothing
        text = repr((self.__module__, self._name, constants, str(treedef), kinds, _settings()))
        path = folder / hashlib.sha256(text.encode()).hexdigest()
        try:
            exported = jax.export.deserialize(_read(path))
        except Exception:  # absent, damaged or of another format: traced anew, and replaced
            try:
                exported = jax.export.export(traced)(*leaves)
                _write(path, exported.serialize())
            except Exception:  # what cannot be written down, such as a printing callback, is compiled as it is
                return traced

        def call(*leaves: Any) -> Any:
            return exported.call(*leaves)

        call.__name__ = self._name
        return jax.jit(call, compiler_options=_asked(self._once))


@functools.cache
def _asked(once: bool) -> dict[str, bool | int] | None:
    """What the compiler is asked for; nothing where there is another one, or one that does not know these words."""
    options = _ONCE if once else _OFTEN
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda: 0, compiler_options=options)()
    except Exception:  # whatever a later version of the compiler says to options that it no longer has
        return None
    return options


def _is_ours(structure: Any) -> bool:
    """Whether all classes in a tree's structure are of sources that `_version` reads."""
    data = structure.node_data()
    if data is not None:
        module = data[0].__module__.split(".")[0]
        if module not in ("jbridge", "builtins"):
            return False
    return all(_is_ours(child) for child in structure.children())


def _settings() -> tuple[str, ...]:
    """Settings of JAX that change what is traced."""
    return (jax.export.default_export_platform(), *(str(getattr(jax.config, name)) for name in _CHANGE_TRACES))


def _read(path: Path) -> bytearray:
    """Returns what `_write` wrote, or raises the ValueError if it has been damaged since: the compiler trusts it."""
    content = path.read_bytes()
    digest, program = content[:_DIGEST], content[_DIGEST:]
    if hashlib.sha256(program).digest() != digest:
        raise ValueError(f"{path}: damaged")
    return bytearray(program)


def _write(path: Path, content: bytes | bytearray) -> None:
    """Writes a file whole or not at all, its sum first; a full disk costs time and changes nothing."""
    name = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            name = file.name
            file.write(hashlib.sha256(content).digest() + content)
        os.replace(name, path)
    except OSError:
        if name is not None:
            Path(name).unlink(missing_ok=True)


@functools.cache
def _version() -> str:
    """One name for the sources of this package and the versions of what lowers them."""
    versions = [version(name) for name in ("jax", "jaxlib", "equinox", "numpy")]
    digest = hashlib.sha256(" ".join(versions).encode())
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()[:24]
