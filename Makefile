# Everything a newcomer needs: `make run`, `make test`, `make check`; on a wearable `make install`. `ARGS` go to the tests.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
SECONDS ?= 60
INPUTS ?= 200000
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1

# Where `make install` puts things, below DESTDIR. The interpreter must not lie in a home folder: the service sees none.
DESTDIR ?=
PREFIX ?= /usr
ETC := $(DESTDIR)/etc/gaiteyes
ENVIRONMENT := $(PREFIX)/lib/gaiteyes
COMMAND := $(DESTDIR)$(PREFIX)/bin/gaiteyes
UNIT := $(DESTDIR)$(PREFIX)/lib/systemd/system/gaiteyes.service
RULES := $(DESTDIR)$(PREFIX)/lib/udev/rules.d/70-gaiteyes.rules
SYSUSERS := $(DESTDIR)$(PREFIX)/lib/sysusers.d/gaiteyes.conf
README := $(DESTDIR)$(PREFIX)/share/doc/gaiteyes/README.md

.PHONY: run test test-long test-beside test-realtime test-hidden test-processors test-kernel fuzz check lint types contracts format lock clean install install-environment install-files uninstall

run: $(INSTALLED)
	$(BIN)/gaiteyes demo --seconds $(SECONDS)

# Files of tests beside each other, each process with one thread of linear algebra.
PYTEST := $(BIN)/python -m pytest
PYTEST_BESIDE := $(ONE_THREAD) $(PYTEST) --numprocesses auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# What needs the machine for itself, because it works in real time: one test after another, no other file read.
PYTEST_REALTIME := $(PYTEST) $$(grep -rl --include='test_*.py' mark.realtime tests)

# The quick tier: what takes no more than a few seconds.
test: $(INSTALLED)
	$(PYTEST_BESIDE) -m "not hidden and not long and not realtime" $(ARGS)
	$(PYTEST_REALTIME) -m "realtime and not long" $(ARGS)

# What takes longer, in the same way.
test-long: $(INSTALLED)
	$(PYTEST_BESIDE) -m "long and not realtime" $(ARGS)
	$(PYTEST_REALTIME) -m "realtime and long" $(ARGS)

# Quick and long at once, in two halves.
test-beside: $(INSTALLED)
	$(PYTEST_BESIDE) -m "not hidden and not realtime" $(ARGS)

test-realtime: $(INSTALLED)
	$(PYTEST_REALTIME) -m realtime $(ARGS)

# Effects hidden anew in every run and counted; ARGS="--hidden-seed N" draws an earlier run's again.
test-hidden: $(INSTALLED)
	$(ONE_THREAD) $(PYTEST) -m hidden tests/hidden $(ARGS)

# The numerical tests with the linear algebra of other processors, on two threads; the other tiers use this one's, on one.
test-processors: $(INSTALLED)
	$(BIN)/python -m tests.processors $(ARGS)

# The drivers and the service on a real kernel, in an emulated machine: Debian, as root; says so where it cannot run.
test-kernel: $(INSTALLED)
	$(BIN)/python -m tests.kernel $(ARGS)

# Damaged input for every decoder, counted; half an hour. INPUTS=, or ARGS="--only C3D".
fuzz: $(INSTALLED)
	$(ONE_THREAD) $(BIN)/python -m tests.fuzz --inputs $(INPUTS) $(ARGS)

# The types take one processor while the tests begin.
check: lint contracts
	$(MAKE) --jobs 2 types test-beside
	$(MAKE) test-realtime
	$(MAKE) test-hidden

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python docs/make_api.py --check

types: $(INSTALLED)
	$(BIN)/mypy

contracts: $(INSTALLED)
	$(BIN)/lint-imports

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Pinned names, versions and markers for every supported Python, made by uv; then whether a Jetson (JetPack 6) has a
# wheel of each.
lock:
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/pip install --quiet uv
	$(VENV)-lock/bin/uv pip compile --quiet --universal --python-version 3.10 --all-extras --no-header \
		--no-annotate --no-emit-index-url --no-emit-find-links pyproject.toml --output-file constraints.txt
	$(VENV)-lock/bin/uv pip compile --quiet --python-platform aarch64-manylinux_2_35 --python-version 3.10 \
		--only-binary :all: --extra rig --extra lab --extra cluster --constraint constraints.txt pyproject.toml > /dev/null
	rm -rf $(VENV)-lock

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[rig,lab,c3d,dev]'
	touch $@

# The service and all it needs; then `systemctl enable --now gaiteyes`. Once more is an update.
install: install-environment install-files
	@test -n "$(DESTDIR)" || ! test -d /run/systemd/system \
		|| { systemd-sysusers && udevadm control --reload && udevadm trigger && systemctl daemon-reload; }

# A virtual environment of the service's own; the only step that needs the network.
install-environment:
	rm -rf build/lib build/bdist.*
	$(PYTHON) -m venv --clear $(DESTDIR)$(ENVIRONMENT)
	$(DESTDIR)$(ENVIRONMENT)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt .
	chmod -R u=rwX,go=rX $(DESTDIR)$(ENVIRONMENT)

# The person's own configuration is never overwritten.
install-files:
	install -d $(dir $(COMMAND) $(UNIT) $(RULES) $(SYSUSERS) $(README)) $(ETC)
	printf '#!/bin/sh\nexec %s/bin/python -IuB -m cli.main "$$@"\n' $(ENVIRONMENT) > $(COMMAND)
	chmod 755 $(COMMAND)
	sed 's|/usr/|$(PREFIX)/|' systemd/gaiteyes.service > $(UNIT)
	chmod 644 $(UNIT)
	install -m 644 systemd/70-gaiteyes.rules $(RULES)
	install -m 644 systemd/gaiteyes.sysusers $(SYSUSERS)
	install -m 644 README.md $(README)
	test -e $(ETC)/gaiteyes.toml || install -m 644 systemd/gaiteyes.toml $(ETC)/gaiteyes.toml

# Leaves the configuration in /etc/gaiteyes and the recordings in /var/lib/gaiteyes.
uninstall:
	@test -n "$(DESTDIR)" || ! test -d /run/systemd/system || systemctl disable --now gaiteyes
	rm -rf $(DESTDIR)$(ENVIRONMENT) $(dir $(README))
	rm -f $(COMMAND) $(UNIT) $(RULES) $(SYSUSERS)

clean:
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
