"""Robot files that contain xacro macros."""

from __future__ import annotations

import builtins
import math
import sys
import tracemalloc

import numpy as np
import pytest

from slidax.arms import from_urdf
from slidax.arms.files import expression, source
from slidax.arms.files.expression import ExpressionError, evaluate
from slidax.core.errors import DefinitionError
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import GOOD, LIMIT, MASS, ORIGIN

pytest.importorskip("xacrodoc")
HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def as_xacro(*changes: str, head: str = "") -> str:
    return changed(GOOD, '<robot name="arm">', HEAD + head, *changes)


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "arm_description"
    (folder / "urdf").mkdir(parents=True)
    (folder / "config").mkdir()
    (folder / "config" / "arm.yaml").write_text("elbow: {effort: 20, upper: !degrees 90}\n")
    (folder / "urdf" / "sizes.xacro").write_text(
        f'{HEAD}<xacro:property name="reach" value="0.4"/><xacro:property name="mass" value="${{5 / 4}}"/></robot>'
    )
    return folder


def test_macros_properties_arguments_and_includes_are_expanded(package):
    path = package / "urdf" / "arm.urdf.xacro"
    head = (
        '<xacro:arg name="effort" default="7"/><xacro:include filename="sizes.xacro"/>'
        '<xacro:include filename="$(find arm_description)/urdf/sizes.xacro"/>'
        '<xacro:property name="all" value="${xacro.load_yaml(\'$(find arm_description)/config/arm.yaml\')}"/>'
        '<xacro:macro name="reach" params="x"><origin xyz="${x} 0 0"/></xacro:macro>'
    )
    limits = LIMIT.replace('effort="20"', 'effort="$(arg effort)"').replace('"1.5"', "\"${all['elbow']['upper']}\"")
    path.write_text(
        as_xacro(MASS, '<mass value="${mass}"/>', ORIGIN, '<xacro:reach x="${reach}"/>', LIMIT, limits, head=head)
    )
    arm = from_urdf(path)
    good = from_urdf(GOOD)
    for field in ("masses", "inertias", "rotations", "translations"):
        np.testing.assert_array_equal(getattr(arm, field), getattr(good, field))
    assert float(arm.limits.torque[1]) == 7.0
    assert float(arm.limits.upper[1]) == pytest.approx(math.pi / 2)
    assert float(from_urdf(path, arguments={"effort": "12"}).limits.torque[1]) == 12.0


def test_xacro_package_is_resolved_from_the_packages_argument(package, tmp_path):
    path = tmp_path / "apart.xacro"
    path.write_text(as_xacro(head='<xacro:include filename="$(find sizes)/urdf/sizes.xacro"/>'))
    with pytest.raises(DefinitionError, match=r"package `sizes` is not found; packages=\{'sizes': FOLDER\}"):
        from_urdf(path)
    assert from_urdf(path, packages={"sizes": package}).joints == 2


HOSTILE = {
    "a lambda": ("(lambda: ().__class__.__base__.__subclasses__())()", "only a function can be called, by its name"),
    "a lambda without underscores": ("(lambda x: x)(1)", "only a function can be called, by its name"),
    "an attribute of a class": ("[].__class__", "the attribute `__class__` is not supported"),
    "vars": ("python.vars(python)", "the function `vars` is not supported"),
    "type": ("python.type(1).mro()", "the function `type` is not supported"),
    "a frame": ("(x for x in [1]).gi_frame.f_back", "the attribute `gi_frame` of a list is not supported"),
    "import": ("python.__import__('os').system('true')", "the attribute `__import__` is not supported"),
    "open": ("open('/etc/passwd').read()", "the function `open` is not supported"),
    "format": ("'{0.__class__}'.format(1)", "the attribute `format` of a str is not supported"),
    "a formatted text": ("f'{().__class__}'", "`JoinedStr` is not supported"),
    "a large power": ("9 ** 9 ** 9", r"`\*\*` needs two numbers, and an integer result of at most"),
    "a long text": ("'a' * 10 ** 9", r"repeated by `\*` would have 1000000000 characters"),
    "a long list": ("list(range(10 ** 9))", "a range of 1000000000 values exceeds the limit"),
    "loops in loops": ("[[x for x in range(9999)] for y in range(9999)]", "more than 100000 steps"),
    "a wide format": ("'%99999999d' % 1", "a format before `%` must not have"),
    "a long text of bytes": ("len(b'a' * 10 ** 9)", "a constant of type `bytes` is not supported"),
    "a power by rounding": ("round(5, -10 ** 8)", "cannot round a number to -100000000 digits"),
    "a product of many integers": ("math.prod([9 ** 1000] * 99999)", "the function `prod` is not supported"),
    "a sum of lists": ("python.sum([[1]] * 99999, [])", "`sum` adds only numbers"),
    "a product of two large integers": ("[(9 ** 1000) * (9 ** 1000)]", "an integer must have at most 4096 bits"),
}
"""Expressions and the reasons for which they are refused."""

FORMS = {"${%s}": "}", "$(eval %s)": ")"}
"""Forms of an expression in a file, and the character that ends it, wherever it stands."""

IN_A_FILE = [
    pytest.param(form % words, id=f"{form % 'E'}-{name}")
    for form, last in FORMS.items()
    for name, (words, _) in HOSTILE.items()
    if last not in words
]


@pytest.mark.parametrize(("words", "reason"), HOSTILE.values(), ids=HOSTILE)
def test_expression_cannot_run_code_or_exhaust_memory(words, reason):
    names = {**vars(builtins), "math": vars(math), "python": vars(builtins)}
    with pytest.raises(ExpressionError, match=reason):
        evaluate(words, names, {})


@pytest.mark.parametrize("value", IN_A_FILE)
def test_hostile_expression_in_a_file_is_refused_in_one_line(value, tmp_path):
    path = tmp_path / "arm.xacro"
    path.write_text(as_xacro(MASS, MASS.replace("1.25", value.replace("<", "&lt;").replace('"', "&quot;"))))
    with pytest.raises(DefinitionError, match="xacro does not expand the robot file") as caught:
        from_urdf(path)
    assert "\n" not in str(caught.value)
    assert "not a valid expression" not in str(caught.value)


def chain(first, *, times):
    """Properties a0 to aN, each of which contains its predecessor twice."""
    later = (f'<xacro:property name="a{i}" value="${{[a{i - 1}, a{i - 1}]}}"/>' for i in range(1, times + 1))
    return f'<xacro:property name="a0" value="{first}"/>' + "".join(later) + f'<link name="${{a{times}}}"/>'


def macros(body, *, times):
    """Macros m0 to mN, each of which calls its predecessor twice, and a call of the last macro."""
    later = (f'<xacro:macro name="m{i}"><xacro:m{i - 1}/><xacro:m{i - 1}/></xacro:macro>' for i in range(1, times + 1))
    return f'<xacro:macro name="m0">{body}</xacro:macro>' + "".join(later) + f"<xacro:m{times}/>"


def blocks(*, times):
    """Blocks b0 to bN, each of which contains its predecessor twice, and an insertion of the last block."""
    later = (
        f'<xacro:property name="b{i}"><xacro:insert_block name="b{i - 1}"/><xacro:insert_block name="b{i - 1}"/>'
        "</xacro:property>"
        for i in range(1, times + 1)
    )
    first = '<xacro:property name="b0"><link name="x"/></xacro:property>'
    return first + "".join(later) + f'<xacro:insert_block name="b{times}"/>'


REPEATED = {
    "macros": macros('<link name="x"/>', times=40),
    "blocks": blocks(times=40),
    "lists": chain("1", times=40),
    "a large macro": f'<xacro:macro name="a"><xacro:a/>{"<b/>" * 3000}</xacro:macro><xacro:a/>',
    "texts": '<xacro:property name="t" value="${\'x\' * 90000}"/>' + '<b c="${t}${t}${t}"/>' * 100,
    "dollars": f'<link name="{"$ " * 20000}"/>',
    "elements": "<b/>" * 5000,
    "attributes": "<b {}/>".format(" ".join(f'c{i}=""' for i in range(5000))),
}


@pytest.mark.parametrize("body", REPEATED.values(), ids=REPEATED)
def test_expansion_with_too_many_steps_is_refused(body, tmp_path, monkeypatch):
    monkeypatch.setattr(expression, "MOST_STEPS", 100_000)
    path = tmp_path / "arm.xacro"
    path.write_text(as_xacro(head=body))
    with pytest.raises(
        DefinitionError, match=r"more than 100000 steps; does .* repeat itself\?.*`xacro FILE"
    ) as caught:
        from_urdf(path)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    "body",
    ['<xacro:macro name="a"><xacro:a/></xacro:macro><xacro:a/>', '<xacro:include filename="arm.xacro"/>'],
    ids=["macro", "file"],
)
def test_a_macro_or_file_that_contains_itself_is_refused(body, tmp_path):
    path = tmp_path / "arm.xacro"
    path.write_text(as_xacro(head=body))
    with pytest.raises(DefinitionError, match="nested too deeply; does one of them contain itself"):
        from_urdf(path)


def test_an_expansion_longer_than_the_limit_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "MOST_BYTES", 10_000)
    path = tmp_path / "arm.xacro"
    path.write_text(as_xacro(head=macros(f"<b>{'x' * 1000}</b>", times=4)))
    with pytest.raises(DefinitionError, match="its expansion has more than"):
        from_urdf(path)


def test_a_macro_may_call_itself_a_hundred_times(tmp_path):
    path = tmp_path / "arm.xacro"
    head = (
        '<xacro:macro name="count" params="n"><b c="${n}"/><xacro:if value="${n > 0}"><xacro:count n="${n - 1}"/>'
        '</xacro:if></xacro:macro><xacro:count n="100"/>'
    )
    path.write_text(as_xacro(head=head))
    assert from_urdf(path).joints == 2


def test_tokenize_and_macro_parameters_do_not_hang_on_hostile_text(tmp_path):
    path = tmp_path / "arm.xacro"
    words = "'" + "a" * 60 + "!'"
    head = (
        f'<xacro:macro name="m" params="a:={"x" * 60}&apos;"/>'
        f"<b c=\"${{xacro.tokenize({words}, 'x](a+)+b[x')}}\" d=\"${{xacro.tokenize('1, 2')[1]}}\"/>"
    )
    path.write_text(as_xacro(head=head))
    assert from_urdf(path).joints == 2


@pytest.mark.parametrize(
    ("words", "value"),
    [
        ("2 * pi / 3", 2 * math.pi / 3),
        ("-radians(90) if side == 'left' else 1", -math.pi / 2),
        ("[2 * x for x in sizes if x > 1][0]", 4),
        ("all.elbow.effort + all['elbow']['effort']", 40),
        ("'_'.join(['a', str(3)])", "a_3"),
        ("math.sqrt(4) ** 3 % 5 // 2", 1.0),
        ("max(1, 2) > 1 and not False", True),
        ("side in ['left', 'right']", True),
    ],
)
def test_expressions_of_robot_files_have_pythons_values(words, value):
    names = {
        **vars(math),
        "math": vars(math),
        "side": "left",
        "sizes": [1, 2],
        "all": {"elbow": {"effort": 20}},
        "str": str,
        "max": max,
    }
    assert evaluate(words, names, {}) == pytest.approx(value)


TOO_LONG = (
    "('a' * 9998).join(reversed(['b'] * 10000))",
    "('a' * 90000).join(dict(zip('bcdefgh', 'bcdefgh')))",
    "'%(a)s' * 4000 % dict(a='x' * 90000)",
    "'%s%s' % ('x' * 90000, 'x' * 90000)",
    "'%999s' * 4000 % tuple(['x'] * 4000)",
    "str(['x' * 90000] * 1000)",
    "['x' * 90000] * 1000",
)


@pytest.mark.parametrize("words", TOO_LONG)
def test_a_text_that_would_be_too_long_is_refused_before_it_is_built(words):
    safe = {function.__name__: function for function in (reversed, zip, dict, str, tuple)}
    tracemalloc.start()
    try:
        with pytest.raises(ExpressionError, match="a text could be too long"):
            evaluate(words, safe, {})
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("words", "value"),
    [
        ("', '.join(reversed(['b', 'a']))", "a, b"),
        ("'-'.join({'a': 1, 'b': 2})", "a-b"),
        ("'%(side)s_%(number)03d' % dict(side='left', number=7)", "left_007"),
        ("'%.3f %%' * 100 % tuple([1.5] * 100)", "1.500 %" * 100),
    ],
)
def test_joined_and_formatted_texts_have_pythons_values(words, value):
    safe = {function.__name__: function for function in (reversed, dict, tuple)}
    assert evaluate(words, safe, {}) == value


def test_undefined_name_in_an_expression_is_reported(tmp_path):
    path = tmp_path / "arm.xacro"
    path.write_text(as_xacro(MASS, '<mass value="${heavy}"/>'))
    with pytest.raises(DefinitionError, match=r"arm\.xacro`: .*heavy"):
        from_urdf(path)


@pytest.mark.parametrize("words", ["1 +", "x: int", "", "lambda: 1"])
def test_an_invalid_expression_is_refused(words):
    with pytest.raises(ExpressionError):
        evaluate(words, {}, {})


def test_an_included_device_or_entity_is_refused(tmp_path):
    path = tmp_path / "arm.xacro"
    path.write_text(as_xacro(head='<xacro:include filename="/dev/zero"/>'))
    with pytest.raises(DefinitionError, match="only regular files are read"):
        from_urdf(path)
    path.write_text("<!DOCTYPE robot [<!ENTITY a 'b'>]>" + as_xacro().partition("?>")[2])
    with pytest.raises(DefinitionError, match="DOCTYPE"):
        from_urdf(path)


def test_error_without_xacrodoc_names_the_extra_to_install(monkeypatch, tmp_path):
    (tmp_path / "arm.xacro").write_text(as_xacro())
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(DefinitionError, match=r"xacrodoc.*pip install 'slidax\[robots\]'"):
        from_urdf(tmp_path / "arm.xacro")


def test_an_incompatible_version_of_xacro_is_not_used(monkeypatch, tmp_path):
    import xacro

    (tmp_path / "arm.xacro").write_text(as_xacro())
    monkeypatch.delattr(xacro, "safe_eval")
    with pytest.raises(DefinitionError, match=r"no `xacro\.safe_eval`.*could run code"):
        from_urdf(tmp_path / "arm.xacro")


def test_reading_a_file_leaves_the_xacro_module_unchanged(tmp_path):
    import xacro

    before = xacro.safe_eval, xacro.parse, xacro.substitution_args._eval
    (tmp_path / "arm.xacro").write_text(as_xacro())
    from_urdf(tmp_path / "arm.xacro")
    assert (xacro.safe_eval, xacro.parse, xacro.substitution_args._eval) == before
