"""Large lightmaps in bands of 1, 2, 3 and 7 ranks: the same bytes, and no rank holds much more than the others.

bands.py WRITER MPIEXEC [SIZE [denoised]]: the program tests/output/write_synthetic.c, the launcher, and the columns and
rows of the larger of two lightmaps. Prints what each number of ranks took; work is the processor's time outside MPI.
With 16384 columns one rank needs 20 GB, and each of seven that many bytes of a made-up scene besides.
"""
import hashlib
import os
import subprocess
import sys
import tempfile

WRITER, MPIEXEC = sys.argv[1:3]
SIZE = sys.argv[3] if len(sys.argv) > 3 else "2048"
MODE = "large-" + "-".join(sys.argv[4:5] + [SIZE])


def hashes(folder):
    found = {}
    for name in sorted(os.listdir(os.path.join(folder, "lightmaps"))):
        with open(os.path.join(folder, "lightmaps", name), "rb") as file:
            found[name] = hashlib.file_digest(file, "sha256").hexdigest()
    return found


def most_of_mean(values):
    return max(values) / (sum(values) / len(values))


with tempfile.TemporaryDirectory() as folder:
    reference = None
    for ranks in (1, 2, 3, 7):
        one = os.path.join(folder, str(ranks))
        os.makedirs(one)
        run = subprocess.run([MPIEXEC, "-n", str(ranks), WRITER, one, MODE], capture_output=True, text=True,
                             env={**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"})
        assert run.returncode == 0, run.stderr
        told = [list(map(float, line.split())) for line in run.stdout.splitlines()]
        work, held = [t[1] for t in told], [t[2] for t in told]
        assert len(told) == ranks, run.stdout
        print("%d ranks: work %.1f s, at most %.2f of the mean; held %.0f MB each, at most %.2f of the mean" % (
            ranks, sum(work), most_of_mean(work), sum(held) / ranks / 1e6, most_of_mean(held)), flush=True)
        assert most_of_mean(held) < 1.5, held
        found = hashes(one)
        assert len(found) == 2 and (reference is None or found == reference), found
        reference = found
print("the same bytes on any number of ranks")
