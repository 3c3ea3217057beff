# From a clone to a running robot: `make run` sets everything up and runs the knee exoskeleton, `make test` runs the tests.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.ONESHELL:
.SILENT:
.NOTPARALLEL:
.DELETE_ON_ERROR:
.PHONY: help run lint coverage stencils test golden test-all test-hardware reference reference-packages soak sanitize build docs wheel wheels clean FORCE

# Without bytecode a start takes twice as long, and the collection of the tests four times.
unexport PYTHONDONTWRITEBYTECODE

RUN ?= diagrams/knee_exo.py --duration 10
TESTS ?=

# The environment is .venv, made with any Python. A PYTHON of another version gets a separate environment beside it.
version = $(shell "$(1)" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
VENV := .venv
ifneq ($(PYTHON),)
ifneq ($(wildcard .venv/bin/python),)
ifneq ($(call version,$(PYTHON)),$(call version,.venv/bin/python))
VENV := .venv-$(call version,$(PYTHON))
endif
endif
endif

# An environment from another place, or whose Python was removed or changed, is made again.
USABLE := $(shell v="$(call version,$(VENV)/bin/python)"; [ -n "$$v" ] && [ -d "$(VENV)/lib/python$$v/site-packages/pip" ] && \
	{ [ -L $(VENV) ] || grep -qF "$(CURDIR)/$(VENV)" $(VENV)/bin/activate; } && echo yes)
ifneq ($(USABLE),yes)
$(VENV)/made: FORCE
endif

RUN_IMPORTS := blocks.families, google.protobuf.descriptor_pb2, graph.order, runtime.cli.run, runtime.record.recorder.process, runtime.record.recorder.writer, mcap.writer, runtime.robot.guardian.process, runtime.robot.rig.buses, runtime.session.session

SOURCES := $(shell find cext -name '*.pyx' -o -name '*.pxd' | LC_ALL=C sort)
STUBBED := $(shell find blocks graph cext/stubs.py -name '*.py')

help:
	echo "make run            set up .venv, build, and run: RUN='$(RUN)'"
	echo "make test           set up .venv, build, lint, and run the tests; select with TESTS='tests/graph -k units'"
	echo "make golden         write the pages in tests/golden again, which tests compare with those that are printed"
	echo "make lint           check style and format with ruff, and types with pyright"
	echo "make coverage       print how many percent of the statements the tests without real time execute"
	echo "make stencils       compile the machine code of kernels for fused schedules, with clang-19"
	echo "make test-hardware  run the tests of real buses: SocketCAN on vcan0, here or under User Mode Linux, and UDP"
	echo "make reference      run the programs of Epically Powerful on emulated devices, in an environment of their own"
	echo "make reference-packages  compare the frames of packages/ with those of their vendors' and public clients"
	echo "make soak           run the long tests; a missing tool, such as the fuzzer, is an error"
	echo "make sanitize       run the tests of native code with AddressSanitizer, UBSan and ThreadSanitizer"
	echo "make build          compile changed modules and write type stubs of blocks and of native modules"
	echo "make docs           build the site into build/site, without a network"
	echo "make test-all       run the tests with every CPython from 3.10 to 3.14, and with the oldest libraries"
	echo "make wheel          write wheel and source archive to dist/"
	echo "make wheels         write and test wheels for x86-64 and aarch64 in dist/"
	echo "make clean          remove built files"
	echo "PYTHON=python3.12 make ...  use another Python"

run: $(VENV)/stubs
	exec $(VENV)/bin/python -m runtime $(RUN)

define ruff
$(VENV)/bin/ruff check --quiet
$(VENV)/bin/ruff format --check --quiet
endef
pyright = $(VENV)/bin/python -m pyright --pythonpath $(VENV)/bin/python

# Two workers more than processors, since many tests wait for a process; types are checked beside them. Tests that wait in real
# time (marked `paced`) follow, with nothing beside them, in two workers more than processors. Those that measure time (`timing`) run
# one at a time. Only the files of these are collected: the collection of all takes 7 s.
marked = $$(grep -rl --include='test_*.py' 'mark\.$(1)' tests)
test: $(VENV)/installed-test $(VENV)/stubs
	$(ruff)
	if [ -n "$(TESTS)" ]; then $(pyright); exec $(VENV)/bin/python -m pytest $(TESTS); fi
	$(pyright) >build/types 2>&1 & types=$$!
	$(VENV)/bin/python -m pytest -n $$(($$(nproc) + 2)) --dist worksteal -m 'not soak and not paced and not timing'
	wait $$types || { cat build/types; exit 1; }
	$(VENV)/bin/python -m pytest -n $$(($$(nproc) + 2)) --dist worksteal -m 'paced and not soak' $(call marked,paced)
	exec $(VENV)/bin/python -m pytest -m 'timing and not soak' $(call marked,timing)

golden: $(VENV)/installed-test $(VENV)/stubs
	$(VENV)/bin/python -m pytest -n 2 --rewrite -m 'not soak' $$(grep -rl --include='test_*.py' '\bgolden(' tests)
	exec git status --short tests/golden

lint: $(VENV)/installed-test $(VENV)/stubs
	$(ruff)
	$(pyright)

# Of Python code in the processes of the tests; what child processes execute is not counted.
coverage: $(VENV)/installed-test $(VENV)/stubs
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check pytest-cov
	COVERAGE_FILE=build/coverage $(VENV)/bin/python -m pytest -n $$(($$(nproc) + 1)) --dist worksteal \
		-m 'not soak and not paced and not timing' --cov=blocks --cov=graph --cov=runtime --cov-report= $(TESTS)
	COVERAGE_FILE=build/coverage exec $(VENV)/bin/python -m coverage report --format=total

stencils: $(VENV)/installed-test
	exec $(VENV)/bin/python -m cext.fused

test-hardware: $(VENV)/installed-test
	$(VENV)/bin/python -m pytest -rs -m '' tests/hardware $(TESTS)
	exec $(VENV)/bin/python -m pytest -rs tests/runtime/robot/guardian tests/runtime/robot/rig $(TESTS)

# pymscl, which the package requires, has wheels for x86-64 and, from glibc 2.39 on, for aarch64; it needs Python 3.11 to 3.13.
reference: $(VENV)/installed-test build/reference/installed
	REFERENCE_PYTHON=$(CURDIR)/build/reference/bin/python SKIPPED_FILES=error \
		$(VENV)/bin/python -m pytest tests/runtime/robot/emulation/test_reference_programs.py $(TESTS)

build/reference/installed:
	$(VENV)/bin/python -m venv build/reference
	build/reference/bin/python -m pip install --quiet epicallypowerful==1.0.7 pymscl==68.4.5 msgpack
	touch $@

reference-packages: $(VENV)/installed-test $(VENV)/stubs
	$(VENV)/bin/python -m pip install --quiet --no-deps --upgrade --target build/clients damiao-motor==1.0.6 moteus==1.1.1
	SKIPPED_FILES=error PYTHONPATH=$(CURDIR)/build/clients exec $(VENV)/bin/python -m pytest tests/test_packages.py $(TESTS)

# With SKIPPED_FILES=error a file whose tests are all skipped is an error: tests/conftest.py.
soak: $(VENV)/installed-test
	SKIPPED_FILES=error $(VENV)/bin/python -m pytest -m soak $(TESTS)
	EXAMPLES=soak exec $(VENV)/bin/python -m pytest -m "not soak and not paced and not timing" \
		$$(grep -rl --include='test_*.py' 'import.*given' tests)

# Builds in build/sanitizing, beside the ordinary one. Takes half an hour the first time.
sanitize: $(VENV)/installed-test
	$(VENV)/bin/python -m tests.sanitizing.laboratory address $(TESTS)
	exec $(VENV)/bin/python -m tests.sanitizing.laboratory thread $(TESTS)

build: $(VENV)/built $(VENV)/stubs

docs: $(VENV)/installed-docs
	exec $(VENV)/bin/python -m tests.docs.site

wheel: $(VENV)/installed-test $(VENV)/stubs
	exec $(VENV)/bin/python -m build --no-isolation

wheels: $(VENV)/stubs
	exec .ci/wheels

# The oldest libraries are those that pyproject.toml names as the minimum of each, on the oldest Python of this machine.
OLDEST := .venv-oldest
test-all:
	for python in $$(.ci/pythons); do $(MAKE) test PYTHON="$$python"; done
	python=$$(.ci/pythons | head -n 1)
	"$$python" -m venv --clear $(OLDEST)
	$(OLDEST)/bin/pip -q install uv
	$(OLDEST)/bin/uv -q pip install --python $(OLDEST)/bin/python --resolution lowest-direct -e '.[test]'
	$(MAKE) VENV=$(OLDEST) $(OLDEST)/packages
	exec $(OLDEST)/bin/python -m pytest -m 'not soak and not paced and not timing'

clean:
	rm -rf build dist docs/api tickwork.egg-info .venv*/built
	find cext -name '*.so' -delete -o -name '*.c' -delete
	git ls-files --others --ignored --exclude-standard '*.pyi' | xargs -r rm
	find blocks cext graph runtime diagrams tests -name __pycache__ -prune -exec rm -rf {} +

FORCE:

# Functions for the recipes below.

define tools
say() { echo "tickwork: $$*" >&2; }

stop() { say "$$@"; exit 1; }

# A Python that is new enough, into $$python.
find_python() {
    local candidate found=
    for candidate in $(if $(PYTHON),"$(PYTHON)",python3 python3.14 python3.13 python3.12 python3.11 python3.10); do
        "$$candidate" -c '' 2>/dev/null || continue
        "$$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 10))' && python=$$candidate && return
        found="$${found:-$$candidate is Python $$("$$candidate" -c 'import platform; print(platform.python_version())')}"
    done
    [ -n "$$found" ] || [ -z "$(PYTHON)" ] || stop "Python '$(PYTHON)' was not found"
    [ -n "$$found" ] || stop "Python is missing. Install it and the other requirements: $$apt python3 python3-venv python3-dev gcc libc6-dev"
    stop "$$found, but 3.10 or newer is required: install a newer one beside it, then PYTHON=python3.12 make ..." \
        "(Debian 12, Ubuntu 22.04 and Raspberry Pi OS 12 include one)"
}

# Report everything that the build requires and that is missing on this machine, with the packages that contain it.
survey() {
    local missing=() packages=() scratch
    scratch=$$(mktemp -d)
    if [ "$(USABLE)" != yes ] && ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then
        missing+=("Python's venv module"); packages+=("$$(python_package)-venv")
    fi
    if ! find_compiler "$$scratch"; then
        missing+=("a C compiler"); packages+=(gcc libc6-dev)
    fi
    if ! has_headers && { [ $${#missing[@]} -gt 0 ] || { [ -d $(VENV)/include ] && ! fetch_headers "$$scratch"; }; }; then
        missing+=("Python's C headers"); packages+=("$$(python_package)-dev")
    fi
    rm -rf "$$scratch"
    if [ $${#missing[@]} -gt 0 ]; then
        printf -v missing '%s, ' "$${missing[@]}"
        stop "missing: $${missing%, }. Install with: $$apt $${packages[*]}"
    fi
}

python_package() {
    case "$${python##*/}" in python3.*) echo "$${python##*/}" ;; *) echo python3 ;; esac
}

# Find a compiler that compiles a small program: CC, the one Python was built with, or any other.
find_compiler() {
    local candidate candidates=("$${CC:-}")
    [ -n "$${CC:-}" ] || candidates=("$$("$$python" -c 'import sysconfig; print(sysconfig.get_config_var("CC"))')" cc gcc clang)
    printf '#include <math.h>\n#include <string.h>\nint main(int n, char **a) { return floor(strlen(a[0]) * 0.1 * n) < 0; }\n' >"$$1/try.c"
    for candidate in "$${candidates[@]}"; do
        $$candidate "$$1/try.c" -o "$$1/try" -lm 2>/dev/null && [ -e "$$1/try" ] && export CC="$$candidate" && return
    done
    return 1
}

has_headers() {
    [ -e "$$("$$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h" ] || [ -e $(VENV)/include/Python.h ]
}

# Debian has Python.h in a separate package. It is unpacked into the environment, where builds find it; this requires no
# administrator and does not change the system.
fetch_headers() {
    local version package options=(-qq -o "Dir::State::Lists=$$1/lists" -o "Dir::Cache=$$1/cache")
    version=$$("$$python" -c 'import sys; print("%d.%d" % sys.version_info[:2]) if sys.base_prefix == "/usr" else sys.exit(1)') || return
    package=libpython$$version-dev
    command -v apt-get dpkg-deb >/dev/null || return
    say "fetching Python's C headers ($$package)"
    (
        mkdir -p "$$1/lists/partial" "$$1/cache/archives/partial"
        cd "$$1"
        apt-get -qq download "$$package" || { apt-get "$${options[@]}" update && apt-get "$${options[@]}" download "$$package"; }
        dpkg-deb -x "$$package"_*.deb .
        cp -r usr/include/python"$$version"/. usr/include/*-linux-gnu* "$(CURDIR)/$(VENV)/include/"
    ) >/dev/null 2>&1
}

# Run pip install, quietly unless it fails, and without bytecode: most modules are never imported. See `compile_imports`.
install() {
    local log=$(VENV)/pip.log
    PIP_RETRIES=$${PIP_RETRIES:-2} $(VENV)/bin/python -m pip --disable-pip-version-check install --no-compile "$$@" >"$$log" 2>&1 && return
    if grep -q 'Retrying (' "$$log"; then
        stop "pip cannot reach the package index: connect to the network, or configure a proxy or mirror for pip (details in $$log)"
    fi
    tail -n 30 "$$log" >&2
    stop "pip failed (complete output in $$log)"
}

# Start to install Tickwork with an extra and pytest: beside the compiler, with uv, in a tenth of pip's time. The modules are
# those that the compiler writes. `install_tickwork` does it where there is no uv, or where pip's settings name another index.
fetch() {
    if [ -x $(VENV)/bin/uv ] && ! $(VENV)/bin/python -m pip config list | grep -qE '[.](index-url|no-index)='; then
        touch $(VENV)/fetched.start
        TICKWORK_MODULES=none $(VENV)/bin/uv pip install --python $(VENV)/bin/python --only-binary :all: --no-build-isolation \
            -e ".[$$1]" pytest
        mv $(VENV)/fetched.start $(VENV)/fetched-$$1
    fi >$(VENV)/uv.log 2>&1 &
}

install_tickwork() {
    [ $(VENV)/fetched-$$1 -nt pyproject.toml ] || install --no-build-isolation -e ".[$$1]" pytest
}

# Compile the libraries that a run imports to bytecode, even if PYTHONDONTWRITEBYTECODE is set; otherwise every start would.
compile_imports() {
    env -u PYTHONDONTWRITEBYTECODE $(VENV)/bin/python -c 'import $(RUN_IMPORTS)'
}

apt="$$([ "$$(id -u)" = 0 ] || echo 'sudo ')apt install"
endef

# Steps of the set-up: environment, build tools, native code, Tickwork. A step is complete if its file is newer than its
# prerequisites; the file has the start time of the step, so that changes during the step count as newer.

$(VENV)/made:
	$(tools)
	if [ "$(USABLE)" = yes ]; then python=$(VENV)/bin/python; else find_python; fi
	survey
	if [ "$(USABLE)" != yes ]; then
	    say "making $(VENV) with Python $$("$$python" -c 'import platform; print(platform.python_version())')"
	    "$$python" -m venv --clear $(VENV)
	    survey
	fi
	touch $@

$(VENV)/tools: pyproject.toml $(VENV)/made
	$(tools)
	touch $@.start
	say "installing the build requirements"
	eval "requirements=($$(sed -n '/^\[build-system\]/,/^$$/s/^requires = \[\(.*\)\]/\1/p' pyproject.toml | tr , ' '))"
	install "$${requirements[@]}"
	(install uv) 2>/dev/null || true
	mv $@.start $@

$(VENV)/sources: FORCE | $(VENV)/tools
	echo "$(SOURCES)" | cmp -s - $@ || echo "$(SOURCES)" >$@

EXTRA := all
$(VENV)/installed-test: EXTRA := test
$(VENV)/installed-docs: EXTRA := docs

$(VENV)/built: setup.py $(SOURCES) $(VENV)/sources $(VENV)/tools
	$(tools)
	touch $@.start
	python=$(VENV)/bin/python
	survey
	[ -e $(VENV)/installed ] || fetch $(EXTRA)
	say "compiling"
	find cext -name '*.so' ! -name 'cython_shared.*' | while read -r it; do [ -e "$${it%%.*}.pyx" ] || rm "$$it"; done
	mkdir -p build
	# -O2, which wheels have, takes a quarter longer. A tick of a fused schedule takes as long with -O1, any other 2 % longer.
	if ! CFLAGS="$${CFLAGS:--O1}" "$$python" setup.py -q build_ext --inplace >build/log 2>&1; then
	    tail -n 60 build/log >&2
	    stop "the native code does not compile (complete output in build/log)"
	fi
	wait
	mv $@.start $@

$(VENV)/installed: pyproject.toml $(VENV)/tools | $(VENV)/built
	$(tools)
	touch $@.start
	say "installing Tickwork with what its documentation uses: the extra 'all', and pytest"
	(install_tickwork all) || {
	    say "without them: networks, tables, Rerun and studies with Dask need $(VENV)/bin/pip install -e '.[all]'"
	    install --no-build-isolation -e .
	}
	compile_imports
	mv $@.start $@

# Editors and type checkers follow the paths on sys.path, but not the finder of pip's editable install. The folder has
# links to the packages and to nothing else of the clone; Python itself is given a finder that finds nothing in it.
$(VENV)/packages: | $(VENV)/made
	$(VENV)/bin/python - $@ <<'END'
	import os, sys, sysconfig
	folder = os.path.abspath(sys.argv[1])
	finder = f'import sys, importlib.machinery as m; p = {folder!r}; sys.path_importer_cache[p] = m.FileFinder(p + "/none")'
	open(os.path.join(sysconfig.get_path("purelib"), "tickwork_packages.pth"), "w").write(f"{folder}\n{finder}\n")
	END
	mkdir -p $@
	ln -sfn ../../blocks ../../cext ../../graph ../../runtime $@

# Stubs are for editors and type checkers: git ignores them, wheels contain them.
$(VENV)/stubs: $(STUBBED) $(SOURCES) $(VENV)/built | $(VENV)/installed $(VENV)/packages
	touch $@.start
	$(VENV)/bin/python -m graph.stubs blocks graph/arithmetic.py & blocks=$$!
	$(VENV)/bin/python -m cext.stubs
	wait $$blocks
	mv $@.start $@

$(VENV)/installed-docs: pyproject.toml $(VENV)/tools | $(VENV)/built
	$(tools)
	touch $@.start
	say "installing Tickwork, its requirements and those of its site"
	install_tickwork docs
	mv $@.start $@

$(VENV)/installed-test: pyproject.toml $(VENV)/tools | $(VENV)/built
	$(tools)
	touch $@.start
	say "installing Tickwork, its requirements and those of its tests"
	install_tickwork test
	compile_imports
	for other in installed installed-docs; do cp -p $@.start $(VENV)/$$other; done
	mv $@.start $@
