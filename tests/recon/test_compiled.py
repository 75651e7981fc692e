"""Kernels on disk: no process takes one kernel's code for another's, and none outlives a change."""

import subprocess
import sys

import numpy as np

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
