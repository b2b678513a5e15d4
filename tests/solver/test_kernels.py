"""The house rules of compiled loops: where they lie, what they are called, and what their arrays are."""

import ast
import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from solver.runtime.ahead import TABLE

SOLVER = Path(__file__).parents[2] / "solver"
KERNELS = SOLVER / "kernels"

TEAM = {"rank", "size", "threads", "barrier"}
"""What every loop of a team takes, see `solver.runtime.team`."""


def decorated(source: str, word: str) -> Iterator[ast.FunctionDef]:
    """Functions with a decorator that has this word."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and any(word in ast.unparse(one) for one in node.decorator_list):
            yield node


def arrays(kernel: ast.FunctionDef, given: list[str] | None) -> set[str]:
    """Parameters that are arrays: of which elements or the shape are read, or that were given as such."""
    names = [argument.arg for argument in kernel.args.args]
    found = {
        node.value.id
        for node in ast.walk(kernel)
        if isinstance(node, ast.Subscript | ast.Attribute) and isinstance(node.value, ast.Name)
    }
    if given is not None:
        found |= {name for name, kind in zip(names, given, strict=True) if re.match(r"Array\(|\w+\[", kind)}
    return (found & set(names)) - TEAM


def undocumented(kernel: ast.FunctionDef, given: list[str] | None) -> set[str]:
    """Its arrays whose shape the docstring does not tell, as `name: (rows, columns)` or `name (rows,)`."""
    told = ast.get_docstring(kernel) or ""
    return {
        name
        for name in arrays(kernel, given)
        if not re.search(rf"(?<![\w.`]){re.escape(name)}\b[^()\n]{{0,60}}\([^)]*[,…]", told)
    }


def parts(arguments: str) -> list[str]:
    """The types in a listed signature."""
    found, depth = [""], 0
    for character in arguments.strip()[1:-1]:
        depth += (character in "([{") - (character in ")]}")
        if character == "," and depth == 0:
            found.append("")
        else:
            found[-1] += character
    return [one.strip() for one in found if one.strip()]


def kept() -> list[tuple[str, ast.FunctionDef]]:
    """Kernels that Python calls, with their modules' names."""
    return [
        (path.stem, kernel)
        for path in sorted(KERNELS.glob("*.py"))
        for kernel in decorated(path.read_text(), "cache=True")
        if not kernel.name.startswith("_")
    ]


GIVEN = {row["name"]: parts(row["arguments"]) for row in json.loads(TABLE.read_text())}


def test_compiled_loops_lie_in_one_folder() -> None:
    elsewhere = [
        f"{path.relative_to(SOLVER)}: {kernel.name}"
        for path in SOLVER.rglob("*.py")
        if path.parent != KERNELS
        for kernel in decorated(path.read_text(), "jit")
    ]
    assert elsewhere == []


def test_a_name_means_one_module() -> None:
    names = Counter(path.stem for path in SOLVER.rglob("*.py") if path.stem != "__init__")
    assert [name for name, count in names.items() if count > 1] == []


@pytest.mark.parametrize(("module", "kernel"), [pytest.param(m, k, id=f"{m}.{k.name}") for m, k in kept()])
def test_a_kernel_tells_the_shape_of_each_array(module: str, kernel: ast.FunctionDef) -> None:
    assert undocumented(kernel, GIVEN.get(f"solver.kernels.{module}.{kernel.name}")) == set()


def test_what_a_kernel_does_not_tell_is_found() -> None:
    source = '''
@njit(cache=True)
def scale(rank, size, image, factor, out):
    """out ← factor · image.

    Args:
        image: what is scaled.
        out: (rows, columns).
    """
    for i in range(out.shape[0]):
        out[i] = factor * image[i]
'''
    (kernel,) = decorated(source, "cache=True")
    assert arrays(kernel, None) == {"image", "out"}
    assert undocumented(kernel, None) == {"image"}
    assert undocumented(
        kernel, ["int64", "int64", "float32[:,::1]", "float32[::1]", "Array(float32, 2, 'C')"]
    ) == {
        "image",
        "factor",
    }
