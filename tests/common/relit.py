"""Bakes whose transport is kept, and relit: for the tests of kiln relight."""
import os

import h5py

import harness
import program
from reading import content, run_json


def kiln(*arguments, ranks=1, slowness=1, lines=None):
    """Runs kiln to its end, which may be any; `slowness`: of rank 0."""
    return program.kiln(*arguments, code=None, ranks=ranks if ranks > 1 else 0, lines=lines,
                        environment={"KILN_SLOW_RANK": "0:%d" % slowness})


def done(*arguments, ranks=1, lines=None):
    run = kiln(*arguments, "--quiet", "--no-preview", "--threads", "1", ranks=ranks, lines=lines)
    assert run.returncode == 0, f"{' '.join(map(str, arguments))}: exit {run.returncode}\n{run.stderr}"


def refused(status, words, *arguments):
    run = kiln(*arguments, "--quiet")
    assert run.returncode == status and words in run.stderr, (arguments, run.returncode, run.stderr)


def refused_damaged(words, folder, *arguments):
    """What is not as the manifest has it is not read; without a manifest, what does not fit its own check."""
    manifest, aside = os.path.join(folder, "manifest"), os.path.join(folder, "manifest.aside")
    refused(harness.BAD_INPUT, "is not as it was written: its hash", "relight", folder, *arguments)
    os.rename(manifest, aside)
    refused(harness.BAD_INPUT, words, "relight", folder, *arguments)
    os.rename(aside, manifest)


def light(folder):
    """All that a bake says of light, as bytes by name."""
    found = {}
    for name in ("kiln.h5", "volume.hdf"):
        with h5py.File(os.path.join(folder, name), "r") as file:
            file.visititems(lambda key, item: found.update({name + "/" + key: item[()].tobytes()})
                            if isinstance(item, h5py.Dataset) and "provenance" not in key else None)
    for name in os.listdir(os.path.join(folder, "lightmaps")):
        found[name] = content(os.path.join(folder, "lightmaps", name))
    return found


def same(one, other, what):
    one, other = light(one), light(other)
    differ = sorted(name for name in one if one[name] != other.get(name))
    assert one.keys() == other.keys() and not differ, (what, differ)


def rays(folder):
    relight = run_json(folder)["relight"]
    return relight["rays_replayed"], relight["rays_traced"]


def kept_files(folder):
    """The bytes of what is kept, by name; not the index, which names where it was kept."""
    folder = os.path.join(folder, "transport")
    return {name: content(os.path.join(folder, name)) for name in os.listdir(folder) if name != "index"}
