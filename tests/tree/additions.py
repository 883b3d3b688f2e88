"""A made-up option, light profile and pass, each in as many files as CONTRIBUTING.md says.

A copy of the repository gets all three by insertions beside lines of its sources, is built, and bakes. So this fails
where an addition needs another file than its paragraph in CONTRIBUTING.md names, or more files than that says, and
where a table does not take a new row. When a line that an insertion stands beside changes, the insertion follows it.

The folder of the copy goes when the test ends; KILN_ADDITIONS=FOLDER keeps it there, and a second run builds less."""
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402
import tree  # noqa: E402
from reading import content  # noqa: E402


class Copy:
    """All tracked files, some of them changed; `touched`: those that were changed or added since it was emptied."""

    def __init__(self):
        self.changed, self.touched = {}, set()

    def read(self, path):
        """The text of a file as it is so far."""
        return self.changed[path] if path in self.changed else tree.read(path)

    def write(self, path, text):
        """Adds a file, or changes one."""
        self.touched.add(path)
        self.changed[path] = text

    def save(self, folder):
        """Writes what differs from what is in the folder: a second build compiles that alone."""
        for path in {*tree.tracked(), *self.changed}:
            source, target = os.path.join(tree.ROOT, path), os.path.join(folder, path)
            new = self.changed[path].encode() if path in self.changed else content(source)
            if os.path.exists(target) and content(target) == new:
                continue
            os.makedirs(os.path.dirname(target), exist_ok=True)
            with open(target, 'wb') as file:
                file.write(new)
            if os.path.exists(source):
                shutil.copymode(source, target)

    def change(self, path, since, anchor, changed):
        """Changes the first line with `anchor` in it, from the first line with `since` on."""
        lines = self.read(path).splitlines(keepends=True)
        begin = next((i for i, line in enumerate(lines) if since in line), None)
        found = None if begin is None else next((i for i in range(begin, len(lines)) if anchor in lines[i]), None)
        assert found is not None, f"{path}: no line with '{anchor}' from one with '{since}' on: change {__file__}"
        lines[found] = changed(lines[found])
        self.write(path, ''.join(lines))

    def after(self, path, anchor, text, since=''):
        """Inserts lines after the first with `anchor` in it."""
        self.change(path, since, anchor, lambda line: line + text)

    def before(self, path, anchor, text, since=''):
        """Inserts lines before it."""
        self.change(path, since, anchor, lambda line: text + line)

    def exchange(self, path, old, new, since=''):
        """Exchanges words in it."""
        self.change(path, since, old, lambda line: line.replace(old, new, 1))


# ---- the option ----

def add_option(copy):
    """--made-up N: a number that changes no light, and stands among the settings of run.json. Returns the file of its
    use, which is any."""
    copy.before('coordinator/job/options.c', '{.name = "texels-per-metre"', '''\
    {.name = "made-up",
     .group = "Lightmaps",
     .kind = KILN_OPTION_UINT32,
     .value = "N",
     .fallback = "0",
     .maximum = 9,
     .help = "a number that changes no light",
     .commands = KILN_FOR_BAKE,
     .offset = AT(lightmaps.made_up)},
''')
    copy.after('coordinator/job/job.h', 'struct kiln_job_lightmaps {', '    uint32_t made_up; /* 0: none */\n')
    copy.after('coordinator/bake/identity/identity.c', 'static const char *const other[] = {', '    "made-up",\n')
    use = 'coordinator/bake/report/run_report.c'
    copy.after(use, 'add_quantities(settings, job);', '''\
    if (job->lightmaps.made_up > 0)
        json_object_set_new(settings, "made_up", json_integer(job->lightmaps.made_up));
''', since='static json_t *settings_json(')
    return {use}


# ---- the light profile ----

MOST_POWER = 1000


def add_profile(copy):
    """A point light whose intensity is a power of the cosine to its axis: extras.cosinePower of a light in glTF."""
    shared = 'shaders/shared/punctual_light.h'
    copy.after(shared, 'kiln_real cos_inner, cos_outer;',
               '    kiln_real cosine_power; /* the share is this power of the cosine to `direction`; 0: it is not */\n')
    copy.after(shared, '{', '''\
    if (KILN_AT(light).cosine_power > 0)
        return kiln_real_of(float_pow(float_max(0.0f, KILN_TO_F32(real3_dot(KILN_AT(light).direction, direction))),
                                      KILN_TO_F32(KILN_AT(light).cosine_power)));
''', since='kiln_real kiln_punctual_profile(')
    copy.after(shared, '{', '''\
    if (KILN_AT(light).cosine_power > 0)
        return kiln_real_of(1);
''', since='kiln_real kiln_punctual_cone(')
    copy.exchange(shared, 'if (!KILN_AT(light).spot)',
                  'if (!KILN_AT(light).spot && !(KILN_AT(light).cosine_power > 0))',
                  since='kiln_real3 kiln_punctual_sample(')
    copy.exchange('worker/scene/scene.h', 'uint32_t reserved;', 'float cosine_power; /* of a point; 0: none */',
                  since='struct kiln_light {')
    copy.exchange('worker/scene/scene.c', '!isfinite(l->range) ||',
                  f'!isfinite(l->range) || !within(&l->cosine_power, 1, 0.0f, {MOST_POWER}.0f) ||')
    copy.after('worker/light/lights.c', 'p->range = (double)l->range;',
               '            p->cosine_power = (double)l->cosine_power;\n')
    copy.after('worker/light/tree.c', 'node.cos_e = l->spot ?', '''\
        if (l->cosine_power > 0.0) {
            node.axis = l->direction;
            node.cos_o = 1.0;
            node.cos_e = 0.0;
        }
''')
    copy.after('shaders/shared/layout_light_real.h', 'KILN_STORED_REAL range, cos_inner, cos_outer;',
               '    KILN_STORED_REAL cosine_power;\n')
    copy.after('worker/backend/vulkan/lights.c', '.cos_outer = p->cos_outer,',
               '                                           .cosine_power = p->cosine_power,\n')
    copy.exchange('shaders/lights.glsl', 'real(light.cos_outer),', 'real(light.cos_outer), real(light.cosine_power),')
    copy.after('coordinator/import/numbers.h', 'ROW(OUTER_CONE,',
               f'    ROW(COSINE_POWER, "cosinePower", 0.0, {MOST_POWER}.0) \\\n')
    copy.after('coordinator/import/gltf_node.c', 'light.range = (float)gltf_number(', '''\
    light.cosine_power =
        (float)gltf_number(g, place, gltf_object(g, place, json, "extras"), KILN_NUMBER_COSINE_POWER, 0.0);
''')
    return set()


# ---- the pass ----

NEAREST_H = '''\
/* The nearest pass: the distance from the middle of each point's texel, along the normal there, to the nearest
 * surface. Items: tile runs. Result: struct kiln_nearest_result, 0 for a point that is not valid. No parameters, no
 * samples, no streams. Rays: one for each valid point. */
#ifndef KILN_WORKER_PASS_NEAREST_H
#define KILN_WORKER_PASS_NEAREST_H

#include "worker/pass/pass.h"

struct kiln_nearest_result {
    float distance; /* m; 0: nothing is there */
};

#endif
'''

NEAREST_EMBREE = '''\
/* The nearest pass (worker/pass/nearest.h). */
#include "worker/pass/nearest.h"

#include <math.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)parameters, (void)part;
    struct tile_run_frame *frame = NULL;
    const int status = kiln_allocate(&frame, 1, sizeof *frame, "the nearest pass", error);
    *work = frame;
    return status;
}

static void work_destroy(void **work) { kiln_free(work); }

static void nearest_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                             size_t tile_run, void *results, uint64_t *rays)
{
    struct tile_run_frame *f = work;
    frame_build(f, b, tile_run, UINT64_MAX, FRAME_PLACES);
    for (uint32_t j = 0; j < f->count; j++) {
        struct kiln_vec3 o, d;
        float tint[3];
        f->partly_buried[j] = false; /* its middle, wherever that is */
        (void)frame_position(f, b, j, 0.5f, 0.5f, &o, &d);
        struct RTCRayHit r = {.ray = {.org_x = o.x,
                                      .org_y = o.y,
                                      .org_z = o.z,
                                      .dir_x = d.x,
                                      .dir_y = d.y,
                                      .dir_z = d.z,
                                      .tfar = INFINITY,
                                      .mask = ~0u},
                              .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
        embree_nearest1(b, context, &r, kiln_ray_seed(o, d), tint);
        if (r.hit.geomID != RTC_INVALID_GEOMETRY_ID)
            ((struct kiln_nearest_result *)results)[f->place[j]].distance = r.ray.tfar;
    }
    *rays += f->count;
}

int embree_nearest(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                   uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, nearest_tile_run,
                                              sizeof(struct kiln_nearest_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
'''

NEAREST_VULKAN = '''\
/* The nearest pass (worker/pass/nearest.h): shaders/nearest.comp over the batch's points. */
#include "worker/pass/nearest.h"

#include "worker/backend/vulkan/chunks.h"

static const struct vulkan_shader nearest_shader = {
    .name = "nearest", .compute = VULKAN_CODE(nearest), .pipeline = VULKAN_CODE(nearest_pipeline)};

struct nearest {
    struct vulkan_backend *b;
    const struct kiln_batch *batch;
    struct gpu_kernel *kernel;
    uint64_t rays;
};

static int prepare(void *context, struct kiln_error *error)
{
    struct nearest *n = context;
    return vulkan_kernel_of(n->b, &nearest_shader, false, 0, &n->kernel, error);
}

static int record(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error)
{
    (void)error;
    const struct nearest *n = context;
    const struct kiln_gpu_nearest_push push = {
        .scene = n->b->scene.address, .chunk = chunk->all, .results = chunk->results};
    vulkan_record(recording, n->kernel, chunk->all.total, 1, &push, sizeof push);
    return KILN_OK;
}

static int take(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error)
{
    (void)words;
    struct nearest *n = context;
    const struct kiln_surface *s = n->b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[tile_run_first], *last = run + tile_run_count - 1;
    const uint64_t first = kiln_own_of_global(s, run->first).at, points = kiln_tile_runs_points(run, last);
    for (uint64_t i = 0; i < points; i++)
        n->rays += kiln_point_valid(s, (struct kiln_own_point){first + i});
    if (n->batch->take == NULL)
        return KILN_OK;
    return n->batch->take(n->batch->context, tile_run_first, tile_run_count, results, error);
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)parameters;
    struct nearest n = {.b = b, .batch = batch};
    const struct vulkan_chunked pass = {.pass = &kiln_pass_nearest,
                                        .pace = KILN_PASS_INDEX_nearest,
                                        .states = true,
                                        .result_bytes = sizeof(struct kiln_nearest_result),
                                        .rows = 1,
                                        .work = 1,
                                        .first_guess = 1 << 18,
                                        .prepare = prepare,
                                        .record = record,
                                        .take = take,
                                        .context = &n};
    const int status = vulkan_run_in_chunks(b, &pass, batch, error);
    *rays += n.rays;
    return status;
}

const struct vulkan_pass vulkan_pass_nearest = {.run = run};
'''

NEAREST_COMP = '''\
/* The nearest pass: one ray a thread, from the middle of a point along its normal. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_nearest_push);

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"

KILN_ARRAY(Distances, float, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    const uint index = push.chunk.origin + x, state = WordArray(push.chunk.states).at[index] & KILN_GPU_STATE_MASK;
    float found = 0.0;
    if (state == KILN_GPU_STATE_VALID || state == KILN_GPU_STATE_BURIED) {
        vec3 position, normal, tint;
        float offset;
        kiln_place(PointArray(push.chunk.points).at[index], push.chunk.parts, 0.5, 0.5, position, normal, offset);
        const uvec3 o = floatBitsToUint(position), d = floatBitsToUint(normal);
        const kiln_hit hit =
            kiln_trace_by_chance(position, normal, kiln_ray_bits_seed(o.x, o.y, o.z, d.x, d.y, d.z), tint);
        found = hit.triangle != KILN_GPU_NONE ? hit.distance : 0.0;
    }
    Distances(push.results).at[x] = found;
}

#include "shaders/main.glsl"
'''

TEST_NEAREST = '''\
/* The nearest pass between two sheets that face each other, on every backend that is there. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "tests/unit/vulkan_device.h"
#include "worker/light/lights.h"
#include "worker/pass/nearest.h"

#define APART 3.0

struct seen {
    const struct kiln_surface *surface;
    uint64_t points;
    double most_off;
};

static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct seen *seen = context;
    const struct kiln_nearest_result *r = results;
    const struct kiln_tile_run *run = &seen->surface->tile_runs[first];
    const uint64_t points = kiln_tile_runs_points(run, run + count - 1);
    for (uint64_t i = 0; i < points; i++)
        seen->most_off = fmax(seen->most_off, fabs((double)r[i].distance - APART));
    seen->points += points;
    return KILN_OK;
}

static void run_on(const char *name, const struct kiln_backend_params *params, const struct kiln_surface *surface)
{
    struct kiln_error error = {""};
    struct kiln_backend *backend = NULL;
    struct seen seen = {.surface = surface};
    const struct kiln_batch all = {.count = surface->tile_run_count, .take = keep, .context = &seen};
    uint64_t rays = 0;
    assert_int_equal(kiln_backend_create(&backend, name, params, &error), KILN_OK);
    assert_int_equal(kiln_backend_set_surface(backend, surface, &error), KILN_OK);
    assert_int_equal(kiln_backend_run(backend, &kiln_pass_nearest, NULL, &all, &rays, &error), KILN_OK);
    print_message("%s: the nearest surface of %u points is %.2g m off at most\\n", name, (unsigned)seen.points,
                  seen.most_off);
    assert_true(seen.points == 2 * 16 * 16 && rays == seen.points && seen.most_off < 1e-4);
    kiln_backend_destroy(&backend);
}

static void sheets_are_apart(void **state)
{
    (void)state;
    static const double whole[4] = {0, 1, 0, 1};
    struct fixture *f = fixture_create();
    struct kiln_geometry *geometry = NULL;
    struct kiln_lights *lights = NULL;
    struct kiln_surface *surface = NULL;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f);
    for (uint32_t i = 0; i < 2; i++) {
        fixture_mesh(f);
        const double z = i == 0 ? 2 : -2; /* fronts face each other */
        fixture_sheet(f, dvec3(-2, i * APART, z), dvec3(4, 0, 0), dvec3(0, 0, -2 * z), 1, whole, 0.0, grey);
        fixture_object(f, i, NULL, 16, 16);
    }
    assert_int_equal(kiln_geometry_create(&geometry, &f->scene, NULL), KILN_OK);
    assert_int_equal(kiln_lights_create(&lights, &f->scene, geometry, NULL), KILN_OK);
    const struct kiln_surface_params how = {.scene = &f->scene, .geometry = geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&surface, &how, &(struct kiln_surface_report){0}, NULL), KILN_OK);
    const struct kiln_backend_params params = {
        .scene = &f->scene, .geometry = geometry, .lights = lights, .threads = 1};
    run_on("embree", &params, surface);
    if (vulkan_device_is_there())
        run_on("vulkan", &params, surface);
    kiln_surface_destroy(&surface);
    kiln_lights_destroy(&lights);
    kiln_geometry_destroy(&geometry);
    fixture_destroy(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(sheets_are_apart)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
'''


def add_pass(copy):
    """`nearest`, on both backends, with a test of its own."""
    copy.write('worker/pass/nearest.h', NEAREST_H)
    copy.exchange('worker/pass/pass.h', 'DO(directions)', 'DO(directions) DO(nearest)',
                  since='define KILN_PASS_LIST_OF_ALL')
    copy.after('worker/pass/passes.c', '#include "worker/pass/links.h"', '#include "worker/pass/nearest.h"\n')
    copy.before('worker/pass/passes.c', '#define ROW(name)', '''\
const struct kiln_pass kiln_pass_nearest = {.index = KILN_PASS_INDEX_nearest,
                                            .name = "nearest",
                                            .what = "distance to the nearest surface",
                                            .domain = KILN_DOMAIN_TILE_RUNS,
                                            .result_bytes = sizeof(struct kiln_nearest_result)};

''')
    copy.write('worker/backend/embree/nearest.c', NEAREST_EMBREE)
    copy.write('worker/backend/vulkan/nearest.c', NEAREST_VULKAN)
    copy.write('shaders/nearest.comp', NEAREST_COMP)
    copy.exchange('shaders/CMakeLists.txt', 'set(tracing_kernels ', 'set(tracing_kernels nearest ')
    copy.before('shaders/shared/push.h', '/* validity.comp', '''\
struct kiln_gpu_nearest_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS results; /* a float each */
};
KILN_SIZE_IS(kiln_gpu_nearest_push, 64);

''')
    copy.write('tests/unit/test_nearest.c', TEST_NEAREST)
    return set()


# ---- the test ----

ADDITIONS = {'option': add_option, 'light profile': add_profile, 'pass': add_pass}
TARGETS = ('kiln', 'test_nearest', 'test_passes')
OPTIONS = ('--quiet', '--no-preview', '--no-export', '--samples-direct', '64', '--samples-probe', '0', '--denoise',
           'none')


def paragraph(kind):
    """What CONTRIBUTING.md says of an addition, and of how many files."""
    text = next(p for p in tree.read('CONTRIBUTING.md').split('\n\n') if re.match(rf'\*\*An? {kind}\W', p))
    return text, int(re.search(r'(\d+) files', text).group(1))


def is_named(path, text):
    """Whether the paragraph names the file, by its path or, beside another, its name alone."""
    made_up = path.replace('nearest', 'NAME')
    return any(re.search(rf'[`/]{re.escape(name)}`', text) for name in {path, made_up, os.path.basename(made_up)})


def done(*command, folder, **more):
    """Runs a command, whose output stands in the message where it fails."""
    process = subprocess.run(command, cwd=folder, capture_output=True, text=True, **more)
    said = process.stdout + process.stderr
    assert process.returncode == 0, f'{" ".join(command)}: exit {process.returncode}\n{said[-8000:]}'
    return said


def build(folder):
    """Configures and builds the copy, with what ccache has where that is there."""
    launchers = [f'-DCMAKE_{c}_COMPILER_LAUNCHER=ccache' for c in ('C', 'CXX') if shutil.which('ccache')]
    cores = str(len(os.sched_getaffinity(0)))
    environment = {**os.environ, 'CCACHE_BASEDIR': folder}
    done('cmake', '--preset', 'release', *launchers, folder=folder, env=environment)
    done('ninja', '-C', 'build/release', '-k', '0', '-j', cores, *TARGETS, folder=folder, env=environment)


class Additions(unittest.TestCase):
    """All three in one copy, built once."""

    @classmethod
    def setUpClass(cls):
        kept = os.environ.get('KILN_ADDITIONS')
        cls.folder = os.path.abspath(kept) if kept else cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix='kiln-additions-'))
        cls.scratch = cls.enterClassContext(tempfile.TemporaryDirectory(prefix='kiln-test-'))
        cls.touched, cls.free, begin = {}, {}, time.monotonic()
        copy = Copy()
        for kind, add in ADDITIONS.items():
            copy.touched = set()
            cls.free[kind] = add(copy)
            cls.touched[kind] = sorted(path for path in copy.touched if not path.startswith('tests/'))
        copy.save(cls.folder)
        build(cls.folder)
        cls.kiln = os.path.join(cls.folder, 'build/release/kiln')
        print(f'built in {time.monotonic() - begin:.0f} s', flush=True)

    def bake(self, name, scene, *options, code=0):
        """Bakes into a folder of that name."""
        folder = os.path.join(self.scratch, name)
        kernels = os.path.join(self.scratch, 'kernels')  # nothing is left in the user's folder
        process = subprocess.run([self.kiln, 'bake', scene, '-o', folder, '--kernel-cache', kernels, *OPTIONS,
                                  *options], capture_output=True, text=True, stdin=subprocess.DEVNULL,
                                 env={**os.environ, 'KILN_VULKAN_VALIDATION': '1'})
        self.assertEqual(code, process.returncode, process.stderr)
        return harness.Bake(folder, process)

    def test_files(self):
        """CONTRIBUTING.md says how many files an addition is in, and which."""
        for kind, touched in self.touched.items():
            with self.subTest(kind):
                text, most = paragraph(kind)
                print(f'{kind}: {len(touched)} of {most} files')
                self.assertLessEqual(len(touched), most, touched)
                self.assertEqual([], [p for p in touched if p not in self.free[kind] and not is_named(p, text)])

    def test_option(self):
        """It is in help, is read from job files and checked, stands in run.json, and changes no bit of light."""
        scene = glb.partition_room(os.path.join(self.scratch, 'room.glb'), False)
        short = ('--texels-per-metre', '4', '--bounces', '1', '--backend', 'embree')
        without = self.bake('without', scene, *short)
        given = self.bake('given', scene, '--made-up', '3', *short)
        with open(os.path.join(self.scratch, 'job.yaml'), 'w') as file:
            file.write('made-up: 4\nscene: room.glb\n')
        by_file = self.bake('by_file', file.name, *short)
        said = [bake.run['job'].get('made_up') for bake in (without, given, by_file)]
        self.assertEqual([None, 3, 4], said)
        self.assertGreater(without.points.total.min(), 0)
        for bake in (given, by_file):
            self.assertEqual(harness.lightmap_hashes(without), harness.lightmap_hashes(bake))
        refused = self.bake('refused', scene, '--made-up', '10', code=64)
        self.assertIn('--made-up', refused.process.stderr)
        self.assertIn('--made-up N', done(self.kiln, 'bake', '--help', 'all', folder=self.scratch))

    def room(self, power, albedo, intensity=10.0, at=(0.3, 2.5, -0.2)):
        """A room with a lamp that points down."""
        scene = glb.Scene()
        glb.box(scene, 'room', (-2, 0, -2), (2, 3, 2), scene.material('walls', (albedo,) * 3), range(6))
        scene.light('lamp', {'type': 'point', 'intensity': intensity, 'color': [1, 1, 1],
                             'extras': {'cosinePower': power}}, translation=list(at),
                    rotation=[-np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
        return scene.write(os.path.join(self.scratch, f'lamp{power}_{albedo}.glb'))

    def check_profile(self, backend):
        """Irradiance I cos^n(a) cos(b) / d^2 below the lamp, a from its axis and b from the normal; 2 pi I / (n + 1) in
        all."""
        intensity, at = 10.0, np.array((0.3, 2.5, -0.2))
        for power in (1, 6):
            bake = self.bake(f'{backend}{power}', self.room(power, 0.0, intensity, at), '--bounces', '0',
                             '--texels-per-metre', '12', '--backend', backend)
            p = bake.points
            away = p.position - at
            square = (away ** 2).sum(axis=1)
            cosine = -away[:, 1] / np.sqrt(square)
            below = (p.normal[:, 1] > 0.99) & (square < 2.5 ** 2 + 1)
            want = intensity * cosine[below] ** (power + 1) / square[below]
            off = np.abs(p.direct[below] / want[:, None] - 1).max()
            flux = (p.direct * p.area[:, None])[p.valid].sum(axis=0) * (power + 1) / (2 * np.pi * intensity)
            balance, is_even = harness.energy(bake.run)
            print(f'{backend}, power {power}: {below.sum()} texels, {100 * off:.2f} % off at most, flux '
                  f'{flux.mean():.4f} of what is sent; {balance}', flush=True)
            self.assertGreater(below.sum(), 300)
            self.assertLess(off, 0.01)
            self.assertLess(np.abs(flux - 1).max(), 0.01)
            self.assertTrue(is_even, balance)

    def test_profile(self):
        """Its closed form, on the host."""
        self.check_profile('embree')

    def test_paths_of_light(self):
        """Paths that begin at the lamp bring the light that gathers bring: directions are drawn by the profile."""
        scene, light = self.room(6, 0.5), {}
        for method in ('cells', 'bdpt'):
            p = self.bake(method, scene, '--method', method, '--bounces', '2', '--texels-per-metre', '3', '--backend',
                          'embree').points
            light[method] = (p.indirect * p.area[:, None])[p.valid].sum()
        print(f'indirect light by paths and by gathers: {light["bdpt"] / light["cells"]:.4f}', flush=True)
        self.assertLess(abs(light['bdpt'] / light['cells'] - 1), 0.02)

    def test_profile_on_device(self):
        """The same on a device, where there is one."""
        if json.loads(done(self.kiln, 'info', '--devices', '--json', folder=self.scratch))['vulkan'] == []:
            self.skipTest('there is no Vulkan device here')
        self.check_profile('vulkan')

    def test_pass(self):
        """Its closed form, and what all rows of the table promise."""
        for name in ('test_nearest', 'test_passes'):
            said = done(os.path.join(self.folder, 'build/release/tests', name), folder=self.folder)
            print('\n'.join(line for line in said.splitlines() if re.search('nearest|embree|vulkan', line)), flush=True)


if __name__ == '__main__':
    unittest.main()
