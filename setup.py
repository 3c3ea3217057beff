"""Build the extension modules: one for each .pyx file in cext, and one that has what Cython would write into each of
them. All other metadata is in pyproject.toml.
"""

import gc
import os
import runpy
from pathlib import Path

import Cython
from Cython.Build import cythonize
from Cython.Compiler.Errors import CompileError
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

# -ffp-contract=off keeps results bit-identical where the processor could fuse a multiply with an add (arm64).
# -falign-loops: the speed of the short loops over the elements of a vector depends on their alignment.
# Modules are stripped, to a fifth of their size, unless CFLAGS has -g: `CFLAGS=-g make build` is for a debugger.
CFLAGS = os.environ.get("CFLAGS", "")
FLAGS = ["-ffp-contract=off", "-fno-math-errno", "-falign-loops=32", "-Wno-unreachable-code"]
if "-O" not in CFLAGS:
    FLAGS.insert(0, "-O2")
STRIPPED = not any(flag.startswith("-g") for flag in CFLAGS.split())
if STRIPPED:
    FLAGS.append("-g0")

# Up to Cython 3.2 only the code of memory views can be shared.
SHARED = "cext.cython_shared" if tuple(map(int, Cython.__version__.split(".")[:2])) >= (3, 3) else None

# The machine code of fused schedules is for kernels with these sources.
hash_of = runpy.run_path(str(Path(__file__).parent / "cext" / "fused" / "sources.py"))["hash_of"]

DIRECTIVES = {
    "boundscheck": False,
    "wraparound": False,
    "cdivision": True,
    "initializedcheck": False,
    "embedsignature": True,
}


class BuildNative(build_ext):
    """Translate and compile what has changed, on all processors."""

    def finalize_options(self):
        super().finalize_options()
        self.parallel = self.parallel or os.cpu_count()
        if self.editable_mode:  # pip gives a temporary folder; reuse the modules of `build_ext --inplace`
            build = self.distribution.get_command_class("build")(self.distribution)
            build.ensure_finalized()
            self.build_lib, self.build_temp = build.build_platlib, build.build_temp

    def run(self):
        gc.set_threshold(100_000, 20, 100)  # for Cython and its processes, which spend a quarter of their time in it
        try:
            translated = cythonize(
                self.extensions,
                nthreads=self.parallel,
                language_level=3,
                compiler_directives=DIRECTIVES,
                shared_utility_qualified_name=SHARED,
            )
        except CompileError as error:  # the compiler has printed the errors
            raise SystemExit(f"Cython finds errors in {error}") from None
        sources = {extension.name: extension.sources for extension in translated}
        for extension in self.extensions:
            extension.sources = sources[extension.name]
        super().run()


def extension(name, source, **options):
    """Return the Extension of a source, with the options of all."""
    return Extension(
        name,
        [source],
        depends=["setup.py"],
        extra_compile_args=FLAGS,
        extra_link_args=["-s"] if STRIPPED else [],
        libraries=["m"],
        **options,
    )


def extensions():
    """Return the Extension of each module."""
    if os.environ.get("TICKWORK_MODULES") == "none":  # the Makefile compiles them in the checkout at the same time
        return []
    return [extension(SHARED, SHARED.replace(".", "/") + ".c")] * bool(SHARED) + [
        extension(
            ".".join(source.with_suffix("").parts),
            str(source),
            define_macros=[("TICKWORK_SOURCES", f'"{hash_of(source.absolute())}"')],
        )
        for source in sorted(Path("cext").rglob("*.pyx"))
    ]


if __name__ == "__main__":
    setup(cmdclass={"build_ext": BuildNative}, ext_modules=extensions())
