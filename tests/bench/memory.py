"""Memory of a bake against what `kiln plan` says: bytes a surface point and bytes a triangle, from pairs of bakes.

  /usr/bin/python3 tests/bench/memory.py --kiln build/release/kiln

The peak of one process (rank), as the kernel counts it. Bytes a point: the difference between two densities of one
scene over the difference in points. Bytes a triangle: the same between two cities, Embree's BVH (as planned) and the
points' share taken off. The aims are 64 and 120.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

CHEAP = ('--samples-direct', 1, '--samples-bounce', 1, '--samples-indirect', 1, '--bounces', 1, '--samples-probe', 1,
         '--probe-spacing')


def planned(kiln, scene, options):
    p = kiln.command('plan', scene, *options, '--json', '--quiet')
    if p.status != 0:
        sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
    return p.json()


def weigh(kiln, table, scene, spacing, *options):
    """(points, triangles, peak, planned BVH, plan)"""
    options = (*CHEAP, spacing, *options)
    plan = planned(kiln, scene, options)
    bake = measure.must(kiln.bake(scene, *options, timeout=3600))
    points, peak = bake.run['points']['count'], bake.run['memory']['peak_rank']
    triangles = bake.run['scene']['triangles']
    table.row(os.path.basename(scene), points, triangles, '%.1f' % (peak / 2**20),
              '%.1f' % (plan['memory_per_rank']['total'] / 2**20),
              '%.1f' % (plan['memory_per_rank']['bvh'] / 2**20))
    bake.remove()
    return points, triangles, peak, plan['memory_per_rank']['bvh'], plan


def main():
    _, kiln = harness.start(__doc__)
    table = harness.Table(('scene', 32), ('points', 10), ('triangles', 10), ('peak MiB', 9), ('planned MiB', 12),
                          ('BVH MiB', 8))
    cornell = measure.made(kiln, 'cornell')
    few = weigh(kiln, table, cornell, 2, '--texels-per-metre', 60)
    many = weigh(kiln, table, cornell, 2, '--texels-per-metre', 180)
    point = (many[2] - few[2]) / (many[0] - few[0])
    small = weigh(kiln, table, measure.made(kiln, 'city', '--triangles', 200000), 50, '--lightmap-max', 4)
    large = weigh(kiln, table, measure.made(kiln, 'city', '--triangles', 2000000), 50, '--lightmap-max', 4)
    grown = (large[2] - large[3]) - (small[2] - small[3]) - point * (large[0] - small[0])
    triangle = grown / (large[1] - small[1])
    print('bytes a surface point: %.1f measured, %.1f planned, at most 64: ratio %.2f' % (
        point, many[4]['bytes_per_point'], point / many[4]['bytes_per_point']))
    print('bytes a triangle, BVH aside: %.1f measured, %.1f planned, at most 120: ratio %.2f' % (
        triangle, large[4]['bytes_per_triangle'], triangle / large[4]['bytes_per_triangle']))


if __name__ == '__main__':
    main()
