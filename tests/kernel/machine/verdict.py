"""What the results file says."""

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tests.kernel.machine.host import FailedError

OUTCOMES = ("passed", "skipped", "failed")


def print_verdict(files: Sequence[Path]) -> bool:
    """Print a table of the tests by file, with failures and skips; return whether all is well.

    Raises FailedError if a machine left no results.
    """
    by_file: dict[str, Counter[str]] = {}
    remarks: list[str] = []
    for junit in files:
        if not junit.exists():
            raise FailedError(f"the machine left no results; see {junit.parent}")
        for case in ElementTree.parse(junit).getroot().iter("testcase"):
            outcome, message = _outcome(case)
            file = (case.get("classname") or case.get("name") or "").rpartition(".")[2]
            by_file.setdefault(file, Counter())[outcome] += 1
            if outcome != "passed":
                remarks.append(f"{outcome}: {file}::{case.get('name')}: {message}")
    print(f"{'':30}" + "".join(f"{outcome:>9}" for outcome in OUTCOMES))
    for file, counts in sorted(by_file.items()):
        print(f"{file:30}" + "".join(f"{counts[outcome]:9}" for outcome in OUTCOMES))
    print("\n".join(remarks))
    passed = sum(counts["passed"] for counts in by_file.values())
    return passed > 0 and not any(counts["failed"] for counts in by_file.values())


def _outcome(case: ElementTree.Element) -> tuple[str, str]:
    for tag, outcome in (("failure", "failed"), ("error", "failed"), ("skipped", "skipped")):
        found = case.find(tag)
        if found is not None:
            return outcome, " ".join((found.get("message") or "").split())[:300]
    return "passed", ""
