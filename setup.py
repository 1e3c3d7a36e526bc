"""Guise's compiled kernels.  Where no compiler is, Guise is installed without them and runs their NumPy twins."""

import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel

SOURCES = "module", "plain", "sse41", "avx2"
# No contraction to fused products: every instruction set gives the same bytes.  Nobody asks for floating-point traps or
# errno, without which loops of comparisons, roots and roundings are vectorised.
GCC = "-std=c++17 -O3 -g0 -ffp-contract=off -fno-math-errno -fno-trapping-math"
FLAGS = ["/std:c++17", "/O2"] if sys.platform == "win32" else GCC.split()


class StableWheel(bdist_wheel):
    """A wheel for this and every later Python, as the kernels use only the stable part of its interface."""

    def get_tag(self):
        python, abi, platform = super().get_tag()
        return ("cp311", "abi3", platform) if python.startswith("cp") else (python, abi, platform)


setup(
    ext_modules=[
        Extension(
            "guise.common._kernels",
            [f"render/native/{name}.cpp" for name in SOURCES],
            depends=sorted(str(path) for path in Path("render/native").glob("*.hpp")),
            define_macros=[("Py_LIMITED_API", "0x030b0000")],
            extra_compile_args=FLAGS,
            extra_link_args=["-s"] if sys.platform == "linux" else [],
            language="c++",
            py_limited_api=True,
            optional=True,
        )
    ],
    cmdclass={"bdist_wheel": StableWheel},
)
