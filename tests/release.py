"""What is uploaded, tried as strangers will: `python -m tests.release`, or parts of it with `--only`.

==========  ============================================================================================
part        does
==========  ============================================================================================
build       sdist and wheel into dist/, their contents and descriptions checked, their parts listed (SBOM)
matrix      Python 3.11 to 3.13 x wheel and sdist x lowest and newest dependencies: installed, every command
            asked for its help, the demonstration run
extras      every extra alone, and all together: installed, what it is for imported
typed       a client under mypy --strict and pyright, against the installed wheel
workflows   GitHub's workflow and action against their schemas; the pre-commit hook in a repository that uses it
audit       known holes of the dependencies; where the list can't be reached, that is said
==========  ============================================================================================
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from uv import find_uv_bin

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
BIN = Path(sys.executable).parent
PYTHONS = ("3.11", "3.12", "3.13")
SHIPPED = (
    "py.typed",
    "banks/C.toml",
    "baselines/bank-C.json",
    "schemas/monitor.json",
    "cli/template.toml",
    "_share/aircraft/gtm/aircraft.toml",
    "_share/faults/drift.toml",
)
EXTRAS = {
    "gym": "gymnasium, gtmbench.gym",
    "logs": "h5py, mcap, openpyxl, pymavlink, serial, pyulog, rosbags",
    "learnt": "jax",
    "rivals": "sklearn",
    "s3": "s3fs, gtmbench.intake.objects",
    "scale": "distributed",
    "theory": "cvxpy, sympy",
}
OF_ANOTHER_PYTHON = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "PYTHONDONTWRITEBYTECODE"}


def say(part, **row):
    print(json.dumps({"part": part, **row}), flush=True)


def run(*command, cwd=ROOT, seconds=900):
    """Return a command's code and what it printed."""
    environment = {name: value for name, value in os.environ.items() if name not in OF_ANOTHER_PYTHON} | {"CI": "1"}
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def must(*command, cwd=ROOT, seconds=900):
    code, printed = run(*command, cwd=cwd, seconds=seconds)
    if code:
        sys.exit(f"{' '.join(map(str, command))} ended with {code}:\n{printed[-3000:]}")
    return printed


def distributions():
    """Return the wheel and the sdist."""
    found = [next(DIST.glob(pattern), None) for pattern in ("*.whl", "*.tar.gz")]
    if None in found:
        sys.exit("dist/ is empty; run: python -m tests.release --only build")
    return found


def environment_of(folder, python, *wanted, resolution="highest"):
    """Return an environment's Python, with something installed into it, or None where there is no such Python."""
    kept = sorted(Path.home().glob(f".pyenv/versions/{python}.*/bin/python{python}"))  # uv looks into the path alone
    if run(find_uv_bin(), "venv", "--quiet", "--no-python-downloads", "--python", (*kept, python)[0], folder)[0]:
        return None
    own = folder / "bin" / "python"
    must(find_uv_bin(), "pip", "install", "--quiet", "--python", own, "--resolution", resolution, *wanted)
    return own


def import_s(python, code):
    """Return the CPU time of a fresh process's import beyond Python's own start, the median of seven, bytecode kept."""

    def cpu_s(code):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        must(python, "-c", code)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    cpu_s(code)  # compiles
    return round(median(map(cpu_s, [code] * 7)) - median(map(cpu_s, ["pass"] * 7)), 2)


def build():
    shutil.rmtree(DIST, ignore_errors=True)
    must(BIN / "python", "-m", "build", "--outdir", DIST, ROOT)
    must(BIN / "twine", "check", "--strict", *distributions())
    wheel, source = distributions()
    held = set(zipfile.ZipFile(wheel).namelist())
    missing = [name for name in SHIPPED if f"gtmbench/{name}" not in held]
    odd = [name for name in held if not name.startswith(("gtmbench/", "gtmbench-"))]
    with tarfile.open(source) as archive:
        of_source = {name.partition("/")[2] for name in archive.getnames()}
    unlike = [name for name in held if name.startswith("gtmbench/") and "_share" not in name and name not in of_source]
    if missing or odd or unlike:
        sys.exit(f"the wheel lacks {missing}, holds {odd}, and what the sdist lacks: {unlike}")
    sizes = {f"{path.name} (MB)": round(path.stat().st_size / 1e6, 1) for path in (wheel, source)}
    with TemporaryDirectory() as folder:
        own = environment_of(Path(folder, "own"), PYTHONS[0], wheel)
        parts = DIST / "gtmbench.cdx.json"
        must(BIN / "cyclonedx-py", "environment", own, "--output-file", parts, "--of", "JSON")
        imports = {f"{code} (s)": import_s(own, code) for code in ("import gtmbench", "import gtmbench.api")}
    components = json.loads(parts.read_text())["components"]
    say("build", **sizes, files=len(held), parts=len(components), **imports)


def matrix():
    wheel, source = distributions()
    passed, tried = 0, 0
    with TemporaryDirectory() as folder:
        for python in PYTHONS:
            for path in (wheel, source):
                for resolution in ("lowest-direct", "highest"):
                    begun_s = time.perf_counter()
                    place = Path(folder, f"{python}-{path.suffix}-{resolution}")
                    own = environment_of(place, python, path, resolution=resolution)
                    if own is None:
                        say("matrix", python=python, left_out="there is no such Python here")
                        continue
                    failed = _smoke(own, place)
                    tried, passed = tried + 1, passed + (not failed)
                    own_s = round(time.perf_counter() - begun_s)
                    say("matrix", python=python, file=path.suffix, versions=resolution, failed=failed, seconds=own_s)
                    shutil.rmtree(place)
    say("matrix", passed=passed, of=tried)
    return passed == tried


def _smoke(own, place):
    """Return what doesn't work."""
    command = own.with_name("gtmbench")
    names = must(own, "-c", "from gtmbench.cli.app import app; print(*app.list_commands(None))", cwd=place).split()
    failed = [name for name in names if run(command, name, "--help", cwd=place)[0]]
    if run(command, "demo", "--out", "demo", cwd=place)[0]:
        failed.append("demo, run")
    if run(find_uv_bin(), "pip", "check", "--python", own)[0]:
        failed.append("dependencies that agree")
    return failed


def extras():
    wheel, _ = distributions()
    good = True
    with TemporaryDirectory() as folder:
        for names in (*((name,) for name in EXTRAS), tuple(EXTRAS)):
            own = environment_of(Path(folder, "-".join(names)), PYTHONS[1], f"{wheel}[{','.join(names)}]")
            if own is None:
                say("extras", left_out=f"there is no Python {PYTHONS[1]} here")
                return True
            modules = ", ".join(EXTRAS[name] for name in names)
            code, printed = run(own, "-c", f"import gtmbench, {modules}")
            good = good and not code
            say("extras", extra="+".join(names), works=not code, **({"said": printed[-300:]} if code else {}))
    return good


def typed():
    """Check a client's types against the wheel; it has its own environment, where gtmbench is no source."""
    wheel, _ = distributions()
    with TemporaryDirectory() as folder:
        own = environment_of(Path(folder, "client"), PYTHONS[0], wheel, "mypy", "basedpyright")
        client = shutil.copy(ROOT / "tests" / "helpers" / "typed_client.py", folder)
        results = {
            "mypy": run(own, "-m", "mypy", "--strict", client, cwd=folder),
            "pyright": run(own.with_name("basedpyright"), "--pythonpath", own, "--level", "error", client, cwd=folder),
            "runs": run(own, client, cwd=folder),
        }
    for name, (code, printed) in results.items():
        say("typed", by=name, works=not code, **({"said": printed[-1500:]} if code else {}))
    return not any(code for code, _ in results.values())


def workflows():
    github = ROOT / ".github"
    checks = {
        "workflow": ("--builtin-schema", "vendor.github-workflows", *(github / "workflows").glob("*.yml")),
        "action": ("--builtin-schema", "vendor.github-actions", ROOT / "action.yml"),
    }
    good = True
    for name, words in checks.items():
        code, printed = run(BIN / "check-jsonschema", *words)
        good = good and not code
        say("workflows", what=name, works=not code, **({"said": printed[-1000:]} if code else {}))
    with TemporaryDirectory() as folder:
        must("git", "init", "-q", cwd=folder)
        must("git", "-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "--allow-empty", "-m", "a", cwd=folder)
        tries = ("try-repo", ROOT, "gtmbench-check", "--verbose", "--all-files")
        Path(folder, "a.toml").write_text("")
        must("git", "add", "a.toml", cwd=folder)
        code, printed = run(BIN / "pre-commit", *tries, cwd=folder)
        good = good and not code
        say("workflows", what="hook", works=not code, **({"said": printed[-1000:]} if code else {}))
    return good


def audit():
    code, printed = run(BIN / "pip-audit", "--progress-spinner", "off", "--skip-editable")
    unknown = printed.count("could not be audited")
    reached = unknown < 5 and not any(word in printed for word in ("ConnectionError", "Max retries", "Traceback"))
    said = {"clean": not code, "said": printed[-1500:]} if reached else {"elsewhere": "pip-audit --skip-editable"}
    say("audit", reached=reached, **said)
    return not reached or not code


PARTS = {"build": build, "matrix": matrix, "extras": extras, "typed": typed, "workflows": workflows, "audit": audit}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    failed = [name for name in parser.parse_args().only if PARTS[name]() is False]
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
