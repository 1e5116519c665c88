#!/usr/bin/env python3
"""Runs the commands that the documentation tells its readers to run: .ci/documented.py [PAGE…]; all pages by default.

Every ```sh block of a page is run, in the page's order and in one shell that stops at the first failure, in a folder that
looks like a clone and goes afterwards. Blocks inside a comment, which no reader sees, prepare what the reader is told to
have. What follows `sh` says how a block is run:

    ```sh              is run
    ```sh serving      stays running in the background until the page ends; what comes next waits until it listens
    ```sh in FILE      is run by FILE, a script of the project; every line of it has to stand there
    ```sh by hand      takes long, or what is not here: that its files exist is all that is looked at

So that this takes minutes and not hours, `cargo run` and `headway` are the binary that the tests have built, new models are
small, ports are free ones, and `cargo test` with a filter only has to find a test, since the step before runs them all.
`curl` fails where the server refuses.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"^```sh(?P<how>[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
PORT = re.compile(r"\b(127\.0\.0\.1|localhost|0\.0\.0\.0):(\d{4})\b")
PAGE_S = 600
RUN = ("", "serving")
SMALL = {"HEADWAY_MODEL__HIDDEN": "8", "HEADWAY_MODEL__EPOCHS": "1", "HEADWAY_LOG__FILTER": "warn"}

# Of what a clone has, that which stands in the folder as a link, because no command writes to it.
LINKED = ("fuzz", "migrations", "src", "tests")

CARGO = r"""#!/usr/bin/env bash
set -euo pipefail
case "$1" in
  run)
    program=headway
    while shift && [[ ${1:---} != -- ]]; do
      [[ $1 == --example ]] && program=@EXAMPLES@/$2
    done
    shift || true
    exec "$program" "$@"
    ;;
  test)
    [[ $# == 1 ]] && exit  # The step before this one.
    arguments=()
    for argument; do [[ $argument == --release ]] || arguments+=("$argument"); done
    [[ " $* " == *" -- "* ]] || arguments+=(--)
    found=$(cd @ROOT@ && HOME=@HOME@ @CARGO@ "${arguments[@]}" --list 2>/dev/null)
    grep -q ': test$' <<<"$found" || { echo "no test is found by: cargo $*" >&2; exit 1; }
    ;;
  build | install) ;;
  *) export HOME=@HOME@; exec @CARGO@ "$@" ;;
esac
"""

CURL = """#!/bin/sh
exec @CURL@ --fail-with-body "$@"
"""


@dataclass(frozen=True)
class Block:
    """Commands of a page."""

    page: str
    line: int
    how: str
    text: str

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


def files(pattern: str) -> list[str]:
    """Files of the project, without those that are made or kept out of it."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", pattern]
    return subprocess.check_output(command, cwd=ROOT, text=True).split("\0")[:-1]


def blocks(page: Path) -> list[Block]:
    """Every block of commands of a page, hidden ones too."""
    text, name = page.read_text(), str(page.relative_to(ROOT))
    return [
        Block(name, text.count("\n", 0, found.start()) + 1, found["how"].strip(), found["text"]) for found in BLOCK.finditer(text)
    ]


def commands(text: str) -> list[str]:
    """Lines, those that a backslash continues in one."""
    lines = text.replace("\\\n", " ").splitlines()
    return [" ".join(line.split()) for line in lines if line.strip() and not line.lstrip().startswith("#")]


def missing_elsewhere(block: Block, file: str) -> list[str]:
    """Lines that the script which should run them has not."""
    if not (ROOT / file).is_file():
        return [f"{block.place}: there is no {file}"]
    there = set(commands((ROOT / file).read_text()))
    return [f"{block.place}: {file} does not run: {line}" for line in commands(block.text) if line not in there]


def missing_files(block: Block) -> list[str]:
    """Files of the project that a command names and that are not there."""
    words = [word for line in commands(block.text) for word in re.split(r"[\s'\"=]+", line)]
    named = [word for word in words if re.fullmatch(r"(\.ci|api|bench|docker|examples|fuzz|packaging|python)/[\w./-]+", word)]
    return [f"{block.place}: there is no {word}" for word in named if not (ROOT / word).exists()]


class Ports:
    """A free port for each that a page names."""

    def __init__(self) -> None:
        self.free: dict[str, int] = {}

    def at(self, port: str) -> int:
        if port not in self.free:
            with socket.socket() as listener:
                listener.bind(("127.0.0.1", 0))
                self.free[port] = listener.getsockname()[1]
        return self.free[port]

    def within(self, text: str) -> str:
        return PORT.sub(lambda found: f"{found[1]}:{self.at(found[2])}", text)


def clone(folder: Path, binaries: Path) -> Path:
    """Makes the folder look like a clone that has been built; gives the folder of its programs."""
    for name in LINKED:
        (folder / name).symlink_to(ROOT / name)
    for name in files("*"):
        if name.split("/")[0] not in LINKED and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    (folder / "target").mkdir()
    (folder / "target" / "release").symlink_to(binaries)
    (folder / "target" / "debug").symlink_to(binaries)
    programs = folder / ".programs"
    programs.mkdir()
    (programs / "headway").symlink_to(binaries / "headway")
    for name, text in [("cargo", CARGO), ("curl", CURL)]:
        real = subprocess.check_output(["/bin/sh", "-c", f"command -v {name}"], text=True).strip()
        places = {name.upper(): real, "ROOT": str(ROOT), "HOME": os.environ["HOME"], "EXAMPLES": str(binaries / "examples")}
        for place, path in places.items():
            text = text.replace(f"@{place}@", shlex.quote(path))
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    return programs


def script(to_run: list[Block], ports: Ports) -> str:
    """One shell script of a page's blocks."""
    lines = ["set -euo pipefail"]
    for block in to_run:
        text = ports.within(block.text)
        lines.append(f"echo {shlex.quote(f'-- {block.place}')}")
        if block.how == "serving":
            named = PORT.search(block.text)
            port = ports.at(named[2] if named else "8080")
            lines.append("{\n" + text + "} </dev/null &")
            lines.append(f"for _ in $(seq 200); do (: </dev/tcp/127.0.0.1/{port}) 2>/dev/null && break; sleep 0.1; done")
            lines.append(f"(: </dev/tcp/127.0.0.1/{port})")
        else:
            lines.append(text)
    return "\n".join(lines)


def not_right(block: Block) -> list[str]:
    """What can be said of a block without running it."""
    if block.how in RUN:
        return []
    if block.how == "by hand":
        return missing_files(block)
    if block.how.startswith("in "):
        return missing_elsewhere(block, block.how.removeprefix("in "))
    return [f"{block.place}: sh {block.how} is no way to run anything"]


def execute(to_run: list[Block], binaries: Path) -> str | None:
    """Runs blocks; what they said when they failed."""
    ports = Ports()
    with tempfile.TemporaryDirectory(prefix="documented-") as temporary:
        folder = Path(temporary)
        programs = clone(folder, binaries)
        environment = {**os.environ, **SMALL, "PATH": f"{programs}:{os.environ['PATH']}", "HOME": temporary}
        environment["HEADWAY_SERVER__LISTEN"] = f"127.0.0.1:{ports.at('8080')}"
        environment["HEADWAY_URL"] = f"http://127.0.0.1:{ports.at('8080')}"
        log, command = folder / ".log", ["bash", "-c", script(to_run, ports)]
        with log.open("wb") as into:
            shell = subprocess.Popen(
                command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=into, stderr=into, start_new_session=True
            )
            try:
                late, failed = "", shell.wait(PAGE_S) != 0
            except subprocess.TimeoutExpired:
                late, failed = f"\nnot done after {PAGE_S} s", True
            finally:
                # Servers too, which stay running.
                with suppress(ProcessLookupError):
                    os.killpg(shell.pid, signal.SIGKILL)
        return log.read_text(errors="replace")[-6000:] + late if failed else None


def run(page: Path, binaries: Path) -> bool:
    """Runs a page; says how long it took, or what went wrong and where."""
    name, found, began = page.relative_to(ROOT), blocks(page), time.monotonic()
    wrong = [problem for block in found for problem in not_right(block)]
    to_run = [block for block in found if block.how in RUN]
    if to_run and (said := execute(to_run, binaries)) is not None:
        wrong += [said, f"{name}: failed after the last place named above"]
    by_hand = [str(block.line) for block in found if block.how == "by hand"]
    elsewhere = len(found) - len(to_run) - len(by_hand)
    lines = f" (lines {', '.join(by_hand)})" if by_hand else ""
    took_s = time.monotonic() - began
    print(f"{name}: {len(to_run)} run in {took_s:.1f} s, {elsewhere} run elsewhere, {len(by_hand)} by hand{lines}", flush=True)
    print(*wrong, sep="\n", end="\n" if wrong else "", file=sys.stderr, flush=True)
    return not wrong


def pages() -> list[Path]:
    """Every page of the project that has commands."""
    return [page for name in files("*.md") if (page := ROOT / name).is_file() and blocks(page)]


def main() -> int:
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("page", nargs="*", type=Path, help="a Markdown file")
    cli.add_argument("--binaries", type=Path, default=ROOT / "target" / "debug", help="the folder of headway and its examples")
    arguments = cli.parse_args()
    # So that what runs ends with this.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    named = [page.resolve() for page in arguments.page] or pages()
    good = [run(page, arguments.binaries.resolve()) for page in named]
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
