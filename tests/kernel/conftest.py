"""The kernel tier runs inside the machine that `make test-kernel` boots; anywhere else its tests are not collected."""

import os

collect_ignore_glob = [] if "GAITEYES_KERNEL_TIER" in os.environ else ["test_*.py"]
