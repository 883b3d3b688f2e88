/* Tests of the strip assignment: each strip has one packer, the work is even, and the order cannot deadlock. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "coordinator/output/exr_strips.h"
#include "coordinator/output/map/bands/strip_exchange.h"
#include "worker/base/memory.h"

enum { OBJECTS = 40, RANKS = 70 };

struct scene {
    struct kiln_lightmap lightmaps[OBJECTS];
    struct kiln_assignment *assignment;
    struct kiln_strip_assignment *strips;
    uint32_t ranks;
};

static void make(struct scene *s, const uint32_t (*sizes)[2], size_t objects, uint32_t ranks, uint64_t budget,
                 uint64_t least)
{
    memset(s, 0, sizeof *s);
    s->ranks = ranks;
    for (size_t i = 0; i < objects; i++) {
        s->lightmaps[i].width = sizes[i][0];
        s->lightmaps[i].height = sizes[i][1];
        s->lightmaps[i].published = 1;
    }
    assert_int_equal(kiln_assignment_create(&s->assignment, s->lightmaps, objects, ranks, budget, UINT64_MAX, NULL), 0);
    assert_int_equal(kiln_strip_assignment_create(&s->strips, s->lightmaps, s->assignment, 0, ranks, least, NULL), 0);
}

static void drop(struct scene *s)
{
    kiln_strip_assignment_destroy(&s->strips);
    kiln_assignment_destroy(&s->assignment);
}

static double texels(const struct scene *s, const struct kiln_strip *strip)
{
    const struct kiln_lightmap *map = &s->lightmaps[strip->object];
    const uint32_t left = map->height - strip->row;
    return (double)map->width * (left < KILN_EXR_ROWS ? left : KILN_EXR_ROWS);
}

/* Each row of each distributed object occurs once, in order; ranks that pack for others own no distributed objects. */
static void check_complete(const struct scene *s)
{
    bool owns[RANKS] = {false}, helps[RANKS] = {false};
    for (size_t i = 0; i < s->strips->count; i++) {
        const struct kiln_strip *strip = &s->strips->strips[i], *before = strip - 1;
        assert_int_equal(strip->owner, s->assignment->owner[strip->object]);
        assert_true(strip->packer < s->ranks);
        owns[strip->owner] = true;
        helps[strip->packer] = helps[strip->packer] || strip->packer != strip->owner;
        const bool first = i == 0 || before->object != strip->object;
        assert_int_equal(strip->row, first ? 0 : before->row + KILN_EXR_ROWS);
        const bool last = i + 1 == s->strips->count || strip[1].object != strip->object;
        if (last)
            assert_true(strip->row + KILN_EXR_ROWS >= s->lightmaps[strip->object].height);
        const bool new_stream = i == 0 || before->owner != strip->owner;
        assert_int_equal(strip->index, new_stream ? 0 : before->index + 1);
        assert_true(strip->index < strip->count);
        if (!new_stream)
            assert_int_equal(strip->count, before->count);
    }
    for (uint32_t r = 0; r < s->ranks; r++)
        assert_false(owns[r] && helps[r]);
}

/* Work of the busiest rank over the mean. */
static double unevenness(const struct scene *s)
{
    double load[RANKS] = {0}, total = 0.0, most = 0.0;
    for (size_t i = 0; i < s->assignment->count; i++) {
        const double size = (double)s->lightmaps[i].width * s->lightmaps[i].height;
        if (s->assignment->round[i] != 0)
            continue;
        total += (KILN_FINISH_WORK + KILN_PACK_WORK) * size;
        load[s->assignment->owner[i]] +=
            (kiln_strip_assignment_has(s->strips, (uint32_t)i) ? KILN_FINISH_WORK : KILN_FINISH_WORK + KILN_PACK_WORK) *
            size;
    }
    for (size_t i = 0; i < s->strips->count; i++)
        load[s->strips->strips[i].packer] += KILN_PACK_WORK * texels(s, &s->strips->strips[i]);
    for (uint32_t r = 0; r < s->ranks; r++)
        most = load[r] > most ? load[r] : most;
    return most / (total / s->ranks);
}

/* Owners that send at most so many strips ahead, packers that take theirs only in the order of their lists: all get
 * done. */
static void check_no_circle(const struct scene *s)
{
    const size_t count = s->strips->count;
    bool *packed = NULL;
    size_t *lists = NULL, lengths[RANKS] = {0}, next[RANKS] = {0}, written[RANKS] = {0}, done = 0;
    assert_int_equal(kiln_allocate(&packed, count, sizeof *packed, "a test", NULL), 0);
    assert_int_equal(kiln_allocate(&lists, count * s->ranks, sizeof *lists, "a test", NULL), 0);
    for (uint32_t r = 0; r < s->ranks; r++)
        lengths[r] = kiln_strip_list(s->strips, r, lists + r * count);
    for (bool moved = true; moved;) {
        moved = false;
        for (uint32_t r = 0; r < s->ranks; r++) {
            size_t first = 0;
            const size_t stream = kiln_strip_stream(s->strips, r, &first);
            for (size_t i = first; i < first + stream; i++)
                packed[i] = packed[i] || s->strips->strips[i].packer == r;
            while (written[r] < stream && packed[first + written[r]]) {
                written[r]++;
                done++;
                moved = true;
            }
            if (next[r] == lengths[r])
                continue;
            const size_t mine = lists[r * count + next[r]];
            const struct kiln_strip *strip = &s->strips->strips[mine];
            if (strip->index < written[strip->owner] + 1) { /* the least that an owner may send ahead */
                packed[mine] = moved = true;
                next[r]++;
            }
        }
    }
    assert_int_equal(done, count);
    kiln_free(&packed);
    kiln_free(&lists);
}

static void test_one_large_object(void **state)
{
    (void)state;
    const uint32_t sizes[4][2] = {{4096, 4096}, {100, 100}, {64, 32}, {512, 1024}};
    for (uint32_t ranks = 1; ranks <= RANKS; ranks = ranks < 8 ? ranks + 1 : 2 * ranks - 3) {
        struct scene s;
        make(&s, sizes, 4, ranks, 1u << 21, 1u << 19);
        check_complete(&s);
        check_no_circle(&s);
        /* on so many the second is large, too */
        assert_int_equal(s.strips->count, ranks == 1 ? 0 : ranks < 33 ? 256 : 256 + 64);
        if (ranks == 2) /* the owner has a fifth of it in any case, and fills up */
            assert_true(unevenness(&s) < 1.02);
        /* what is left when it packs nothing */
        const double alone = (double)KILN_FINISH_WORK / (KILN_FINISH_WORK + KILN_PACK_WORK) * ranks;
        assert_true(unevenness(&s) < (alone > 1.0 ? alone : 1.0) * 1.05);
        drop(&s);
    }
}

static void test_packers_take_turns(void **state)
{
    (void)state;
    const uint32_t sizes[1][2] = {{1024, 1600}};
    struct scene s;
    make(&s, sizes, 1, 11, 1u << 21, 1);
    assert_int_equal(s.strips->count, 100);
    for (size_t first = 0; first + 20 <= 100; first++) { /* nobody's strips stand together */
        uint32_t packs[11] = {0};
        for (size_t i = first; i < first + 20; i++)
            packs[s.strips->strips[i].packer]++;
        for (uint32_t r = 0; r < 11; r++)
            assert_true(packs[r] <= 4);
    }
    drop(&s);
}

/* Equal objects on as many ranks are even already; so are many small ones. */
static void test_even_rounds_stay(void **state)
{
    (void)state;
    uint32_t sizes[OBJECTS][2];
    for (size_t i = 0; i < OBJECTS; i++)
        sizes[i][0] = sizes[i][1] = 1024;
    for (uint32_t ranks = 1; ranks <= OBJECTS; ranks++) {
        struct scene s;
        make(&s, (const uint32_t(*)[2])sizes, OBJECTS, ranks, UINT64_MAX / 2, 1);
        if (OBJECTS % ranks == 0)
            assert_int_equal(s.strips->count, 0);
        check_complete(&s);
        assert_true(unevenness(&s) < 1.26);
        drop(&s);
    }
}

static void test_any_sizes(void **state)
{
    (void)state;
    uint32_t random = 1;
    for (int round = 0; round < 300; round++) {
        uint32_t sizes[OBJECTS][2];
        const size_t objects = 1 + (size_t)round % OBJECTS;
        for (size_t i = 0; i < objects; i++)
            for (int k = 0; k < 2; k++) {
                random = random * 747796405u + 2891336453u;
                sizes[i][k] = 1 + (random >> 16) % (i % 5 == 0 ? 3000 : 300);
            }
        struct scene s;
        make(&s, (const uint32_t(*)[2])sizes, objects, 1 + (uint32_t)(round * 7) % RANKS,
             round % 3 == 0 ? 1u << 21 : UINT64_MAX / 2, round % 2 == 0 ? 1 : 10000);
        check_complete(&s);
        check_no_circle(&s);
        drop(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_one_large_object),
                                       cmocka_unit_test(test_packers_take_turns),
                                       cmocka_unit_test(test_even_rounds_stay), cmocka_unit_test(test_any_sizes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
