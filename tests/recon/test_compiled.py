"""Kernels on disk: no process takes one kernel's code for another's, and none outlives a change."""

import os
import subprocess
import sys

import numpy as np
import pytest

from recon.compiled import SharedCacheFile, kernel, sources

WRITER = """
import sys
from recon.compiled import SharedCacheFile

folder, name = sys.argv[1:]
sys.stdin.readline()  # both start together
for i in range(120):
    SharedCacheFile(folder, "f", "stamp").save((name, i), f"code of {name} {i}")
"""


def test_two_processes_that_store_at_once_keep_every_entry_under_its_own_key(tmp_path):
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path), name], stdin=subprocess.PIPE) for name in "ab"]
    for writer in writers:
        writer.stdin.write(b"\n")
        writer.stdin.close()
    assert [writer.wait(60) for writer in writers] == [0, 0]
    file = SharedCacheFile(tmp_path, "f", "stamp")
    assert [file.load((name, i)) for name in "ab" for i in range(120)] == [f"code of {name} {i}" for name in "ab" for i in range(120)]


def test_an_entry_of_other_sources_is_not_used(tmp_path):
    SharedCacheFile(tmp_path, "f", "before").save("key", "code")
    assert SharedCacheFile(tmp_path, "f", "before").load("key") == "code"
    assert SharedCacheFile(tmp_path, "f", "after").load("key") is None


def test_a_kernel_carries_the_digest_of_all_kernels_and_computes():
    @kernel()
    def twice(x):
        return 2 * x

    assert twice._cache._cache_file._source_stamp == sources()
    assert len(sources()) == 64
    assert twice(np.float64(1.5)) == 3.0


@pytest.mark.slow
def test_two_processes_compile_all_that_a_first_solve_needs(tmp_path):
    def run(code):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout

    run("from recon import warm_up_beside; warm_up_beside()()")
    compiled = """
from numba.core import event
from recon.warm import solves, transforms
with event.install_recorder("numba:compile") as record:
    transforms()
    solves()
names = {e.data["dispatcher"].py_func.__module__ for _, e in record.buffer if hasattr(e.data["dispatcher"], "_cache")}
print(sorted(name for name in names if name.startswith("recon")))
from recon import warm_up_beside
import os
import subprocess
subprocess.Popen = None  # all is there: nothing is started
warm_up_beside()()
"""
    assert run(compiled).strip() == "[]"
