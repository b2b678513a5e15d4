"""Fetch the bundled libraries from the npm registry, check them, and put what the page needs here.

    python service/web/vendor/fetch.py          # fetch and write
    python service/web/vendor/fetch.py --check  # is what lies here what `versions.json` names?

Needs npm, which knows the registry. Whoever installs lidarboost needs neither: the files are part of it.
"""

import base64
import hashlib
import json
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]


def main(check: bool) -> int:
    """Bring every package; or compare the files with their checksums, and return how many differ."""
    packages = json.loads((HERE / "versions.json").read_text(encoding="utf-8"))
    if not check:
        for name, package in packages.items():
            fetch(name, package)
    files = {target: file["sha256"] for p in packages.values() for target, file in p["files"].items()}
    wrong = [target for target, expected in files.items() if sha256(ROOT / target) != expected]
    for target in wrong:
        print(f"{target} is not what versions.json names; fetch it again", file=sys.stderr)
    return len(wrong)


def fetch(name: str, package: dict[str, Any]) -> None:
    """Download one package, hold it against its checksum, and write its files with their few edits."""
    with tempfile.TemporaryDirectory() as folder:
        wanted = f"{name}@{package['version']}"
        subprocess.run(["npm", "pack", "--silent", wanted], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        archive = next(Path(folder).glob("*.tgz"))
        found = "sha512-" + base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
        if found != package["integrity"]:
            raise SystemExit(f"{wanted}: its checksum is {found}, expected {package['integrity']}")
        with tarfile.open(archive) as members:
            for target, file in package["files"].items():
                member = members.extractfile(f"package/{file['from']}")
                assert member is not None, file
                text = member.read().decode("utf-8")
                for old, new in file.get("replace", {}).items():
                    assert old in text, f"{target}: {old!r} is not there any more"
                    text = text.replace(old, new)
                (ROOT / target).parent.mkdir(parents=True, exist_ok=True)
                (ROOT / target).write_text(text + file.get("append", ""), encoding="utf-8")


def sha256(path: Path) -> str:
    """Checksum of a file; empty where there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
