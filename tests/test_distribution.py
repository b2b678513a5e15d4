"""The wheel, built through the sdist, installs into an environment of its own and works there."""

import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NEEDED = ("pyproject.toml", "README.md", "LICENSE", "lidarboost.py", "solver", "drivers", "service")
PUBLIC = ("fuse", "FusionOptions", "Fused", "SlidingFusion", "Client", "open_camera", "open_recording")


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(
        [str(word) for word in command], cwd=cwd, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, f"{command}:\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of a fresh environment that holds the wheel; the dependencies come from this one."""
    place = tmp_path_factory.mktemp("distribution")
    source = place / "source"
    source.mkdir()
    for name in NEEDED:
        here = ROOT / name
        if here.is_dir():
            shutil.copytree(here, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(here, source / name)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", place / "dist", source, cwd=place)
    (wheel,) = (place / "dist").glob("*.whl")
    assert list((place / "dist").glob("*.tar.gz"))

    environment = place / "environment"
    venv.create(environment, with_pip=False)
    python = environment / "bin" / "python"
    site = Path(
        run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=place).strip()
    )
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    run(sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index",
        "--force-reinstall", wheel, cwd=place)  # fmt: skip
    return python


def test_everything_public_is_there_and_comes_from_the_wheel(python: Path, tmp_path: Path) -> None:
    code = f"import lidarboost; [getattr(lidarboost, name) for name in {PUBLIC}]; print(lidarboost.__file__)"
    assert str(python.parents[1]) in run(python, "-c", code, cwd=tmp_path)


@pytest.mark.parametrize("how", ["console script", "module"])
def test_the_command_runs(python: Path, tmp_path: Path, how: str) -> None:
    command = [python.with_name("lidarboost")] if how == "console script" else [python, "-m", "lidarboost"]
    assert "run" in run(*command, "--help", cwd=tmp_path)


def test_data_files_travel_with_the_packages(python: Path, tmp_path: Path) -> None:
    code = (
        "import solver, drivers, service; from pathlib import Path;"
        "print(all((Path(p.__file__).parent / 'py.typed').exists() for p in (solver, drivers, service)))"
    )
    assert run(python, "-c", code, cwd=tmp_path).strip() == "True"


def test_the_camera_profiles_are_in_the_wheel(python: Path, tmp_path: Path) -> None:
    code = "from drivers.usb.profile import shipped_profiles; print(*(p.model for p in shipped_profiles()))"
    assert run(python, "-c", code, cwd=tmp_path).split() == ["SR2A", "SR2B", "SR3000", "SR4000"]
