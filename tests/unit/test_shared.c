/* Tests of what C and GLSL share, from both sides: offsets of structs as the compiled kernels have them against C's,
 * and constants that C and GLSL write differently. Needs no device. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/files/publish.h"
#include "shaders/shared/area_light.h"
#include "shaders/shared/color.h"
#include "shaders/shared/mask.h"
#include "shaders/shared/push.h"
#include "shaders/shared/warp.h"
#include "worker/base/memory.h"

/* ---- a reader of SPIR-V: names and offsets of struct members (SPIR-V specification, sections 2.3 and 3.42) ---- */

enum { OP_NAME = 5, OP_MEMBER_NAME = 6, OP_MEMBER_DECORATE = 72, DECORATION_OFFSET = 35, HEADER_WORDS = 5 };

struct module {
    const char *name;
    uint32_t *words;
    size_t count;
};

/* Read by read_modules. */
static struct module modules[] = {
    {"choose", NULL, 0},      {"direct", NULL, 0},           {"gather", NULL, 0},       {"gather_reduce", NULL, 0},
    {"probes", NULL, 0},      {"probes_reduce", NULL, 0},    {"intersect", NULL, 0},    {"validity", NULL, 0},
    {"occlusion", NULL, 0},   {"occlusion_reduce", NULL, 0}, {"directional", NULL, 0},  {"directional_reduce", NULL, 0},
    {"path", NULL, 0},        {"guided", NULL, 0},           {"guided_learn", NULL, 0}, {"guided_reduce", NULL, 0},
    {"replay_take", NULL, 0}, {"patches", NULL, 0},          {"sight_forget", NULL, 0}, {"sight_open", NULL, 0},
    {"sight_close", NULL, 0}};

static int read_modules(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof modules / sizeof *modules; i++) {
        char path[512], *bytes = NULL;
        size_t size = 0;
        struct kiln_error error = {""};
        (void)snprintf(path, sizeof path, KILN_KERNELS_NAMED "/%s.spv", modules[i].name);
        if (kiln_read_file(path, 1 << 24, &bytes, &size, &error) != KILN_OK)
            fail_msg("%s", error.message);
        modules[i].words = (uint32_t *)(void *)bytes;
        modules[i].count = size / sizeof(uint32_t);
    }
    return 0;
}

static int free_modules(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof modules / sizeof *modules; i++)
        kiln_free(&modules[i].words);
    return 0;
}

/* The next instruction from *at on with this code; NULL: none. */
static const uint32_t *next(const struct module *m, size_t *at, uint32_t code)
{
    while (*at < m->count) {
        const uint32_t *words = m->words + *at;
        const uint32_t length = words[0] >> 16;
        assert_true(length != 0);
        *at += length;
        if ((words[0] & 0xffffu) == code)
            return words;
    }
    return NULL;
}

static uint32_t member_number(const struct module *m, uint32_t type, const char *member)
{
    size_t at = HEADER_WORDS;
    for (const uint32_t *i; (i = next(m, &at, OP_MEMBER_NAME)) != NULL;)
        if (i[1] == type && strcmp((const char *)(i + 3), member) == 0)
            return i[2];
    return UINT32_MAX;
}

/* Offset of a member; UINT32_MAX when the type is not laid out in memory (a copy of it in registers). */
static uint32_t member_offset(const struct module *m, uint32_t type, uint32_t number)
{
    size_t at = HEADER_WORDS;
    for (const uint32_t *i; (i = next(m, &at, OP_MEMBER_DECORATE)) != NULL;)
        if (i[1] == type && i[2] == number && i[3] == DECORATION_OFFSET)
            return i[4];
    return UINT32_MAX;
}

/* Returns the number of kernels that have the member at this offset. Fails where one has it elsewhere. */
static size_t check_member(const char *type, const char *member, size_t offset)
{
    size_t seen = 0;
    for (size_t k = 0; k < sizeof modules / sizeof *modules; k++) {
        const struct module *m = &modules[k];
        size_t at = HEADER_WORDS;
        for (const uint32_t *i; (i = next(m, &at, OP_NAME)) != NULL;) {
            if (strcmp((const char *)(i + 2), type) != 0)
                continue;
            const uint32_t found = member_offset(m, i[1], member_number(m, i[1], member));
            if (found != UINT32_MAX && found != offset)
                fail_msg("%s: %s.%s stands at %u, in C at %zu", m->name, type, member, found, offset);
            seen += found != UINT32_MAX;
        }
    }
    return seen;
}

struct member {
    const char *type, *name;
    size_t offset;
};
#define MEMBER(type, member)                                                                                           \
    {                                                                                                                  \
#        type, #        member, offsetof(struct type, member)                                                          \
    }

static void offsets(void **state)
{
    (void)state;
    static const struct member members[] = {MEMBER(kiln_gpu_intersect_push, scene),
                                            MEMBER(kiln_gpu_intersect_push, directions),
                                            MEMBER(kiln_gpu_intersect_push, hits),
                                            MEMBER(kiln_gpu_intersect_push, count),
                                            MEMBER(kiln_gpu_validity_push, chunk),
                                            MEMBER(kiln_gpu_validity_push, sobol),
                                            MEMBER(kiln_gpu_validity_push, counts),
                                            MEMBER(kiln_gpu_validity_push, stream),
                                            MEMBER(kiln_gpu_validity_push, looks),
                                            MEMBER(kiln_gpu_direct_push, scene),
                                            MEMBER(kiln_gpu_direct_push, chunk),
                                            MEMBER(kiln_gpu_direct_push, pass),
                                            MEMBER(kiln_gpu_hemisphere_push, chunk),
                                            MEMBER(kiln_gpu_hemisphere_push, hemisphere),
                                            MEMBER(kiln_gpu_hemisphere, sobol),
                                            MEMBER(kiln_gpu_hemisphere, slices),
                                            MEMBER(kiln_gpu_hemisphere, samples),
                                            MEMBER(kiln_gpu_hemisphere, reuse),
                                            MEMBER(kiln_gpu_hemisphere, row_step),
                                            MEMBER(kiln_gpu_hemisphere_reduce_push, chunk),
                                            MEMBER(kiln_gpu_hemisphere_reduce_push, results),
                                            MEMBER(kiln_gpu_hemisphere_reduce_push, split),
                                            MEMBER(kiln_gpu_guided_push, hemisphere),
                                            MEMBER(kiln_gpu_guided_push, probes),
                                            MEMBER(kiln_gpu_guided_push, guided),
                                            MEMBER(kiln_gpu_guided_reduce_push, split),
                                            MEMBER(kiln_gpu_guided_reduce_push, guided),
                                            MEMBER(kiln_gpu_replay_push, lights),
                                            MEMBER(kiln_gpu_replay_push, results),
                                            MEMBER(kiln_gpu_replay_push, first),
                                            MEMBER(kiln_gpu_replay_push, samples),
                                            MEMBER(kiln_gpu_replay_push, split),
                                            MEMBER(kiln_gpu_replay_push, groups),
                                            MEMBER(kiln_gpu_patches_push, most_added),
                                            MEMBER(kiln_gpu_patches_push, open),
                                            MEMBER(kiln_gpu_patch, place_in_run),
                                            MEMBER(kiln_gpu_sight, reals),
                                            MEMBER(kiln_gpu_sight, groups),
                                            MEMBER(kiln_gpu_sight_run, used),
                                            MEMBER(kiln_gpu_sight_run, unknown),
                                            MEMBER(kiln_gpu_sight_forget_push, runs),
                                            MEMBER(kiln_gpu_sight_push, columns),
                                            MEMBER(kiln_gpu_sight_push, runs),
                                            MEMBER(kiln_gpu_held, powers),
                                            MEMBER(kiln_gpu_held, count),
                                            MEMBER(kiln_gpu_held, seed),
                                            MEMBER(kiln_gpu_held_light, unit_squared),
                                            MEMBER(kiln_gpu_held_point, bit),
                                            MEMBER(kiln_gpu_held_power, low),
                                            MEMBER(kiln_gpu_guided, near_probes),
                                            MEMBER(kiln_gpu_guided, guides),
                                            MEMBER(kiln_gpu_guided, exponents),
                                            MEMBER(kiln_gpu_guided_result, learnt),
                                            MEMBER(kiln_gpu_occlusion_push, hemisphere),
                                            MEMBER(kiln_gpu_occlusion_push, distance),
                                            MEMBER(kiln_gpu_occlusion_result, count),
                                            MEMBER(kiln_gpu_directional_result, count),
                                            MEMBER(kiln_gpu_probes_push, positions),
                                            MEMBER(kiln_gpu_probes_push, index),
                                            MEMBER(kiln_gpu_probes_push, count),
                                            MEMBER(kiln_gpu_probes_push, seed),
                                            MEMBER(kiln_gpu_probes_push, far),
                                            MEMBER(kiln_gpu_probes_reduce_push, slices),
                                            MEMBER(kiln_gpu_probes_reduce_push, slice_count),
                                            MEMBER(kiln_gpu_chunk, points),
                                            MEMBER(kiln_gpu_chunk, list),
                                            MEMBER(kiln_gpu_chunk, origin),
                                            MEMBER(kiln_gpu_chunk, total),
                                            MEMBER(kiln_gpu_direct, scratch),
                                            MEMBER(kiln_gpu_direct, sobol_stride),
                                            MEMBER(kiln_gpu_direct, split),
                                            MEMBER(kiln_gpu_scene, trace),
                                            MEMBER(kiln_gpu_scene, materials),
                                            MEMBER(kiln_gpu_scene, lights),
                                            MEMBER(kiln_gpu_scene, records),
                                            MEMBER(kiln_gpu_scene, object_count),
                                            MEMBER(kiln_gpu_trace, extent),
                                            MEMBER(kiln_gpu_lights, rows),
                                            MEMBER(kiln_gpu_lights, groups),
                                            MEMBER(kiln_gpu_lights, rotation),
                                            MEMBER(kiln_gpu_lights, environment),
                                            MEMBER(kiln_gpu_point, shading),
                                            MEMBER(kiln_gpu_point, flags),
                                            MEMBER(kiln_gpu_point, spread),
                                            MEMBER(kiln_gpu_piece, until),
                                            MEMBER(kiln_gpu_mask, most),
                                            MEMBER(kiln_gpu_piece_triangle, triangle),
                                            MEMBER(kiln_gpu_piece_triangle, along_e2),
                                            MEMBER(kiln_gpu_result, present),
                                            MEMBER(kiln_gpu_result, count),
                                            MEMBER(kiln_gpu_material, transmission),
                                            MEMBER(kiln_gpu_material, seen_color),
                                            MEMBER(kiln_gpu_path_triangle, shading2),
                                            MEMBER(kiln_gpu_path_triangle, flags),
                                            MEMBER(kiln_gpu_path_triangle, lift),
                                            MEMBER(kiln_gpu_path_sums, rays),
                                            MEMBER(kiln_gpu_texture, wrap_v),
                                            MEMBER(kiln_gpu_coating, material),
                                            MEMBER(kiln_gpu_hit, tint),
                                            MEMBER(kiln_gpu_lightmap, shift)};
    for (size_t i = 0; i < sizeof members / sizeof *members; i++)
        if (check_member(members[i].type, members[i].name, members[i].offset) == 0)
            fail_msg("no kernel has %s.%s in memory", members[i].type, members[i].name);
}

/* The reader sees a member that stands elsewhere. */
static void reader(void **state)
{
    (void)state;
    const struct module *m = &modules[2];
    size_t at = HEADER_WORDS;
    for (const uint32_t *i; (i = next(m, &at, OP_NAME)) != NULL;)
        if (strcmp((const char *)(i + 2), "kiln_gpu_hemisphere") == 0) {
            const uint32_t number = member_number(m, i[1], "slices");
            assert_int_equal(number, 1);
            assert_int_equal(member_number(m, i[1], "no such member"), UINT32_MAX);
            if (member_offset(m, i[1], number) != UINT32_MAX)
                assert_int_equal(member_offset(m, i[1], number), 8);
        }
}

/* ---- constants: a ratio of integers is the decimal fraction that it stands for ---- */

static void constants(void **state)
{
    (void)state;
    assert_true(KILN_RED_WEIGHT(KILN_RATIO) == 0.2126 && KILN_GREEN_WEIGHT(KILN_RATIO) == 0.7152 &&
                KILN_BLUE_WEIGHT(KILN_RATIO) == 0.0722);
    assert_true(KILN_RED_WEIGHT(KILN_RATIO32) == 0.2126f && KILN_GREEN_WEIGHT(KILN_RATIO32) == 0.7152f &&
                KILN_BLUE_WEIGHT(KILN_RATIO32) == 0.0722f);
    assert_true(KILN_SPHERICAL_FROM == 0.02 && KILN_TARGET_SPREAD_MOST == 0.125 && KILN_TARGET_OPPOSITE == -0.99);
    assert_true(KILN_SHADOW_LENGTH == 1.0 - 0x1p-20 && KILN_FLOAT_BELOW_ONE == 0x1.fffffep-1f);
    assert_true(KILN_INVERSE_PI == (float)(1.0 / KILN_PI));
    assert_true(kiln_unit_float(0) == 0x1p-24f && kiln_unit_float(UINT32_MAX) < 1.0f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(offsets), cmocka_unit_test(reader),
                                       cmocka_unit_test(constants)};
    return cmocka_run_group_tests(tests, read_modules, free_modules);
}
