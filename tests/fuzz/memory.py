"""Every allocation of kiln's own code fails once: no signal, 71 with a sentence, or none the worse.

    memory.py --kiln PROGRAM --server FUZZ_SERVER [--step N] [--most 5000]

For each command the fork server (fork_server.c) lets the k-th allocation fail, for k = 1, 1 + N, ... up to as many as
the command makes. --step 1, the full run, takes minutes. Single processes: what ranks do when one of them has no memory
is tests/mpi's."""
import collections
import os
import sys
import tempfile

import mutate
import readers

NO_MEMORY = 71


def commands(w):
    """{name: what makes the case and returns the arguments}."""
    def with_bake(*words):
        def make():
            folder = w.copy('bake', w.seeds.bake)
            return [folder if word == 'FOLDER' else word for word in words]
        return make

    def scene(name, data):
        return lambda: ['info', w.put(name, data), *readers.SMALL]

    def job():
        w.put('scene.gltf', readers.quad(False))
        return ['info', w.put('job.yaml', readers.JOBS[2]), *readers.SMALL]

    def picture():
        w.put('image.png', w.seeds.jpeg[0])
        return ['info', w.put('scene.gltf', readers.quad()), '--environment', w.put('sky.exr', w.seeds.exr[0]),
                *readers.SMALL]

    def obj():
        w.put('box_ok.mtl', w.seeds.obj[0][1])
        return ['info', w.put('scene.obj', w.seeds.obj[0][0]), *readers.SMALL]

    def bake():
        return ['bake', w.seeds.scene(), '-o', w.output('bake'), *readers.BAKE]

    def resume():
        return readers.resume(w, w.copy('bake', w.seeds.checkpoints[0]))

    return {'info GLB': scene('scene.glb', w.seeds.glb[-1]), 'info with images': picture, 'info OBJ': obj,
            'info job': job, 'verify': with_bake('verify', 'FOLDER'),
            'probe': with_bake('probe', 'FOLDER', '0.3', '0.4', '0.5'), 'status': with_bake('status', 'FOLDER'),
            'report': with_bake('report', 'FOLDER', '-o', w.output('r.html')),
            'compare': with_bake('compare', 'FOLDER', w.seeds.bake),
            'view': with_bake('view', 'FOLDER', '-o', w.output('v.png'), '--width', '8', '--height', '8'),
            'export': with_bake('export', 'FOLDER', '-o', w.output('s.glb')), 'bake': bake, 'bake that goes on': resume}


def failing(worker, name, make, options):
    """The counts of what became of it; wrong ones are told."""
    ends, k, most = collections.Counter(), 0, 0  # 0: none fails, which tells how many there are
    while k <= min(most, options.most):
        worker.work.clean()
        arguments = make()
        worker.watch.touched()
        outcome = worker.servers[arguments[0] == 'bake'].run(arguments, False, k)
        most = max(most, outcome.allocations)
        wrong = [w for w in worker.judge.wrongs(outcome, False) if w[0] != 'status %d' % NO_MEMORY]
        if wrong:
            worker.fail(name, k, arguments, wrong, outcome)
        if k > 0 or wrong:
            ends['wrong' if wrong else outcome.number] += 1
        k += options.step if k > 0 else 1
    return ends, most


def main():
    options = mutate.arguments((('--step', {'type': int, 'default': 1, 'help': 'only every so-manieth allocation'}),
                                ('--most', {'type': int, 'default': 5000}), ('--only', {'default': ''})))
    if not mutate.prepare(options):
        return 77
    bad = 0
    with tempfile.TemporaryDirectory(prefix='kiln-fuzz-') as options.work:
        folder = os.path.join(options.work, 'seeds')
        os.makedirs(folder)
        worker = mutate.Worker(options, 0, readers.Seeds(folder, options.kiln, {**os.environ, **mutate.MPI}))
        for name, make in commands(worker.work).items():
            if options.only not in name:
                continue
            ends, most = failing(worker, name, make, options)
            bad += ends['wrong']
            print('%-18s %5d allocations: %s' %
                  (name, most, ', '.join('%s %d times' % pair for pair in sorted(ends.items(), key=str))), flush=True)
        worker.stop()
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
