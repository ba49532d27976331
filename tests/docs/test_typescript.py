"""TypeScript snippets of README and docs have the types of the package: each is compiled as a module of its own."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from .snippets import PAGES, ROOT, snippets

WEB = ROOT / "web"
FOUND = [snippet for page in PAGES for snippet in snippets(page) if snippet.language in ("ts", "tsx")]


def _check(folder: Path, texts: dict[str, str]) -> str:
    shutil.copy(Path(__file__).parent / "globals.d.ts", folder)
    (folder / "node_modules").symlink_to((WEB / "node_modules").resolve())
    for name, text in texts.items():
        (folder / name).write_text(f"{text}\nexport {{}};\n")
    # A snippet shows how to call, not how to guard: what it declares may stay unused.
    relaxed = {"noUnusedLocals": False, "noUncheckedIndexedAccess": False}
    config = {"extends": str(WEB / "tsconfig.json"), "compilerOptions": relaxed, "include": ["*.ts", "*.tsx"]}
    (folder / "tsconfig.json").write_text(json.dumps(config))
    compiler = WEB / "node_modules/typescript/bin/tsc"
    done = subprocess.run(["node", str(compiler), "-p", str(folder)], capture_output=True, text=True, timeout=600)
    return done.stdout


@pytest.mark.slow
def test_snippets_have_the_types_of_the_package(tmp_path):
    names = {f"{s.where.replace('/', '-').replace('.md:', '-')}.{s.language}": s.text for s in FOUND}
    assert len(names) >= 10
    said = _check(tmp_path, names | {"wrong.ts": "new LearnedScene(1).lamp;"})
    wrong = [line for line in said.splitlines() if "error TS" in line]
    assert [line for line in wrong if "wrong.ts" in line], said
    assert not [line for line in wrong if "wrong.ts" not in line]
