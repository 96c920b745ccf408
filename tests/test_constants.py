"""Numbers at module level stand in the `constants.py` of their package, with a comment, and in use.

A number is a literal. Bodies of functions and classes (the defaults of options) are no module
level. Kernels of a package without such a file have one in their own folder.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "src" / "farpoint"
PACKAGES = ("pose", "_kernels", "path", "tracks", "odometry", "synthetic/kernels", "camera/kernels")
# Folders of the kernels of one package each.
KERNELS = tuple(sorted(folder.relative_to(ROOT).as_posix() for folder in ROOT.glob("*/kernels")))
# Upper bounds of the numbers of packages with kernels: a new one replaces another. `pose` and
# `_kernels` are counted together.
MOST_NUMBERS = {
    ("pose", "_kernels"): 209,
    ("path",): 61,
    ("tracks",): 42,
    ("synthetic/kernels",): 19,
    ("camera/kernels",): 2,
}


def assignments(text: str) -> Iterator[tuple[ast.stmt, ast.expr, list[str]]]:
    """Statements at module level that bind names: the statement, its value and the names."""
    for node in ast.parse(text).body:
        match node:
            case ast.Assign():
                targets: list[ast.expr] = node.targets
            case ast.AnnAssign() | ast.AugAssign():
                targets = [node.target]
            case _:
                continue
        if node.value is not None:
            names = [
                part.id
                for target in targets
                for part in ast.walk(target)
                if isinstance(part, ast.Name)
            ]
            yield node, node.value, names


def numbers(value: ast.expr) -> list[ast.Constant]:
    """Numeric literals anywhere in an expression, as in tuples and arguments of calls."""
    return [
        part
        for part in ast.walk(value)
        if isinstance(part, ast.Constant) and type(part.value) in (int, float, complex)
    ]


def numbers_in(text: str) -> list[str]:
    """Names bound to an expression with a number at module level."""
    return [name for _, value, names in assignments(text) if numbers(value) for name in names]


def without_comment(text: str) -> list[str]:
    """Names bound at module level without a comment in the line above."""
    lines = text.split("\n")
    return [
        name
        for node, _, names in assignments(text)
        if not lines[node.lineno - 2].startswith("# ")
        for name in names
    ]


def identifiers(text: str) -> set[str]:
    """Names that a module reads, whether imported or its own."""
    return {
        node.id
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
    }


def unused(constants: str, others: list[str]) -> list[str]:
    """Constants that neither another module nor another constant reads."""
    read = identifiers(constants).union(*map(identifiers, others))
    return [name for _, _, names in assignments(constants) for name in names if name not in read]


def constants_of(package: str) -> str:
    return (ROOT / package / "constants.py").read_text("utf-8")


def test_every_file_of_constants_is_checked():
    assert {path.parent for path in ROOT.rglob("constants.py")} == {
        ROOT / each for each in PACKAGES
    }


@pytest.mark.parametrize("package", dict.fromkeys(PACKAGES + KERNELS))
def test_no_number_is_bound_elsewhere(package: str):
    modules = [path for path in (ROOT / package).rglob("*.py") if path.name != "constants.py"]
    assert len(modules) > (1 if package in KERNELS else 5)
    found = {path.name: numbers_in(path.read_text("utf-8")) for path in modules}
    assert {name: listed for name, listed in found.items() if listed} == {}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_constant_has_a_comment(package: str):
    assert without_comment(constants_of(package)) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_every_constant_is_used(package: str):
    modules = [path for path in ROOT.rglob("*.py") if path.name != "constants.py"]
    others = [constants_of(each) for each in PACKAGES if each != package]
    texts = [path.read_text("utf-8") for path in modules]
    assert unused(constants_of(package), texts + others) == []


@pytest.mark.parametrize("packages", MOST_NUMBERS)
def test_packages_with_kernels_have_few_numbers(packages: tuple[str, ...]):
    found = [
        number
        for package in packages
        for _, value, _ in assignments(constants_of(package))
        for number in numbers(value)
    ]
    assert 0 < len(found) <= MOST_NUMBERS[packages]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("A = 1.0", ["A"]),
        ("A: float = -1", ["A"]),
        ("A, B = 1, C", ["A", "B"]),
        ("A = f(x=(B, [2]))", ["A"]),
        ("A = {n: n for n in (3, 5)}", ["A"]),
        ("A = B, True, '1'", []),
        ("class A:\n    b: int = 1", []),
        ("def f():\n    a = 1", []),
    ],
)
def test_numbers_are_found(text: str, names: list[str]):
    assert numbers_in(text) == names


def test_constants_without_comment_or_use_are_found():
    assert without_comment("# a\nA = 1\n\nB = 2\n# c\n\nC = 3") == ["B", "C"]
    assert unused("A, B, C = D, E, F = range(3)\nG = A", ["B", "from x import C", "x.D"]) == [
        *"CDEFG"
    ]
