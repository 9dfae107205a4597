"""Effects and lab formats of others that cannot be used: one line says where and what to change."""

from collections.abc import Callable
from pathlib import Path

import pytest

from femnl.core.errors import ParameterError
from femnl.effects import from_folder, library
from femnl.io import labfiles
from tests.unit.plugin_page import CAUSE, EFFECT, FILES, forget

pytestmark = pytest.mark.usefixtures("_own_plug_ins")
Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install modules, by name, as the entry points of one group."""
    monkeypatch.syspath_prepend(str(tmp_path / "installed"))

    def write(group: str, **modules: str) -> None:
        about = tmp_path / "installed" / "toy_lab-1.0.dist-info"
        about.mkdir(parents=True)
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-lab\nVersion: 1.0\n")
        names = "".join(f"{name} = toy_{name}\n" for name in modules)
        (about / "entry_points.txt").write_text(f"[{group}]\n{names}")
        for name, text in modules.items():
            (tmp_path / "installed" / f"toy_{name}.py").write_text(text, encoding="utf-8")
        forget()

    return write


REFUSALS = {
    "raises": (
        "1 / 0",
        "ZeroDivisionError: division by zero; repair",
    ),
    "is no Python": ("def", "SyntaxError: invalid syntax"),
    "ends the program": ("raise SystemExit(1)", "SystemExit: 1; repair"),
    "defines nothing": ("", r"defines no (EFFECT|FORMAT); set (EFFECT|FORMAT) = (Effect|Format)\("),
    "defines something else": ("EFFECT = FORMAT = 3", r"(EFFECT|FORMAT) is of type int; make it"),
}
UNFIT = {
    "stage": (
        EFFECT.replace('"points"', '"smell"'),
        "no kind of measurement has the stage 'smell'; the stages are acquisition, ",
    ),
    "scale": (
        EFFECT.replace("per_drive_square", "reach"),
        "the scale 'reach' of softening is given by no kind that the effect shows in; these give "
        ".*drive, ",
    ),
    "name": (
        EFFECT.replace(CAUSE, "gas_damping"),
        "the name 'gas_damping' is taken by femnl.effects.gas_damping; choose another",
    ),
}
ALL = REFUSALS | UNFIT


@pytest.mark.parametrize(("text", "says"), ALL.values(), ids=ALL)
def test_a_file_that_defines_no_effect_of_use_is_refused_in_one_line(
    text: str, says: str, effects_folder: Path
) -> None:
    (effects_folder / "wrong.py").write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=says) as refusal:
        from_folder(effects_folder)
    assert str(refusal.value).startswith(f"{effects_folder / 'wrong.py'}: ")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("text", "says"), ALL.values(), ids=ALL)
def test_a_module_that_defines_no_effect_of_use_is_refused_in_one_line(
    text: str, says: str, install: Install
) -> None:
    install("femnl.effects", wrong=text)
    with pytest.raises(ParameterError, match=says) as refusal:
        library()
    assert str(refusal.value).startswith("toy_wrong (entry point wrong of toy-lab): ")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("text", "says"), REFUSALS.values(), ids=REFUSALS)
def test_a_module_that_defines_no_format_is_refused_in_one_line(
    text: str, says: str, install: Install
) -> None:
    install("femnl.labfiles", wrong=text)
    with pytest.raises(ParameterError, match=says) as refusal:
        labfiles.formats()
    assert str(refusal.value).startswith("toy_wrong (entry point wrong of toy-lab): ")
    assert "\n" not in str(refusal.value)


def test_an_entry_point_that_names_no_module_is_refused(install: Install, tmp_path: Path) -> None:
    install("femnl.effects", one=EFFECT)
    (tmp_path / "installed" / "toy_one.py").unlink()
    with pytest.raises(ParameterError, match="No module named 'toy_one'; repair or uninstall toy-"):
        library()


def test_two_plug_ins_of_one_name_are_refused(install: Install) -> None:
    install("femnl.effects", one=EFFECT, two=EFFECT)
    says = rf"toy_two \(.*\): the name '{CAUSE}' is taken by toy_one \(entry point one of toy-lab\)"
    with pytest.raises(ParameterError, match=says):
        library()


def test_two_formats_of_one_name_are_refused(install: Install) -> None:
    analyser = FILES["our_lab/analyser.py"]
    install("femnl.labfiles", one=analyser, two=analyser)
    with pytest.raises(ParameterError, match="the name 'our analyser' is taken by toy_one"):
        labfiles.formats()


def test_two_files_of_one_name_are_refused(effects_folder: Path) -> None:
    (effects_folder / "twin.py").write_text(EFFECT, encoding="utf-8")
    says = rf"twin\.py: the name '{CAUSE}' is taken by .*softening\.py"
    with pytest.raises(ParameterError, match=says):
        from_folder(effects_folder)


def test_a_folder_that_is_missing_or_empty_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="missing: no such folder; check the path"):
        from_folder(tmp_path / "missing")
    with pytest.raises(ParameterError, match=r"holds no \*\.py file"):
        from_folder(tmp_path)


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "gone.py").symlink_to(tmp_path / "nowhere")
    with pytest.raises(ParameterError, match=r"gone\.py: cannot be read \(No such file"):
        from_folder(tmp_path)
