"""The native part of the build: every .pyx in cext becomes an extension module. All else stands in pyproject.toml."""

import os
from pathlib import Path

from Cython.Build import cythonize
from Cython.Compiler.Errors import CompileError
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

# -ffp-contract=off keeps results bit-identical where the processor could fuse a multiply with an add (arm64).
# -falign-loops: the short loops over the elements of a vector are at the mercy of where they happen to lie.
FLAGS = ["-ffp-contract=off", "-fno-math-errno", "-falign-loops=32", "-Wno-unreachable-code"]
if "-O" not in os.environ.get("CFLAGS", ""):
    FLAGS.insert(0, "-O2")

DIRECTIVES = {
    "boundscheck": False,
    "wraparound": False,
    "cdivision": True,
    "initializedcheck": False,
    "embedsignature": True,
}


class BuildNative(build_ext):
    """Translates and compiles what has changed, on all processors."""

    def finalize_options(self):
        super().finalize_options()
        self.parallel = self.parallel or os.cpu_count()
        if self.editable_mode:  # pip gives it a throw-away folder; what `build_ext --inplace` has compiled is as good
            build = self.distribution.get_command_class("build")(self.distribution)
            build.ensure_finalized()
            self.build_lib, self.build_temp = build.build_platlib, build.build_temp

    def run(self):
        try:
            translated = cythonize(
                self.extensions, nthreads=self.parallel, language_level=3, compiler_directives=DIRECTIVES
            )
        except CompileError as error:  # the compiler has told what is wrong, and where
            raise SystemExit(f"Cython finds errors in {error}") from None
        sources = {extension.name: extension.sources for extension in translated}
        for extension in self.extensions:
            extension.sources = sources[extension.name]
        super().run()


if __name__ == "__main__":
    setup(
        cmdclass={"build_ext": BuildNative},
        ext_modules=[
            Extension(
                ".".join(source.with_suffix("").parts),
                [str(source)],
                depends=["setup.py"],
                extra_compile_args=FLAGS,
                libraries=["m"],
            )
            for source in sorted(Path("cext").rglob("*.pyx"))
        ],
    )
