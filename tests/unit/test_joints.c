/* Joints of objects that touch, and the tiles beside them: found whatever the vertices, transforms and sides; not found
 * where no surface goes on. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>

#include "coordinator/output/map/seams/edge_tree.h"
#include "coordinator/output/map/denoise/ghosts.h"
#include "coordinator/output/map/seams/joints.h"
#include "tests/unit/surface_scene.h"
#include "worker/base/memory.h"

enum { OBJECTS = 4, SIDE = 32 };

/* Sheets of which each lies where its transform puts the square from 0 to 1 in x and y, with its front along z. */
struct sheets {
    struct fixture *f;
    struct kiln_surface surface;
    struct kiln_lightmap lightmaps[2 * OBJECTS];
    struct kiln_joints *joints;
};

/* The layout of every sheet: turned, so that u runs against y and v along x. */
static void place_of(const struct sheets *s, uint32_t map, const float texel[2], double place[3])
{
    const uint32_t object = kiln_map_object(&s->surface, map);
    const double *m = s->f->objects[object].transform;
    const double x = ((double)texel[1] / SIDE - 0.1) / 0.8, y = ((double)texel[0] / SIDE - 0.9) / -0.8;
    for (int c = 0; c < 3; c++)
        place[c] = m[4 * c] * x + m[4 * c + 1] * y + m[4 * c + 3];
}

static void add_sheet(struct sheets *s, uint32_t cuts, const double transform[12])
{
    const double uv[4] = {0.0, 1.0, 0.0, 1.0};
    const uint32_t mesh = fixture_mesh(s->f), object = fixture_object(s->f, mesh, transform, SIDE, SIDE);
    const size_t first = s->f->scene.vertex_count;
    fixture_sheet(s->f, dvec3(0, 0, 0), dvec3(1, 0, 0), dvec3(0, 1, 0), cuts, uv, 0.3, 0);
    for (size_t v = first; v < s->f->scene.vertex_count; v++) {
        const struct kiln_vec3 p = s->f->positions[v];
        s->f->lightmap[v] = (struct kiln_vec2){0.9f - 0.8f * p.y, 0.1f + 0.8f * p.x};
    }
    s->lightmaps[object] =
        (struct kiln_lightmap){.width = SIDE, .height = SIDE, .tiles_x = SIDE / 8, .tiles_y = SIDE / 8, .published = 1};
}

static struct sheets begin(bool double_sided)
{
    struct sheets s = {.f = fixture_create()};
    s.f->materials[fixture_material(s.f, 0.5f, 0.5f, 0.5f)].double_sided = double_sided;
    return s;
}

/* Finds the joints. Returns the sum of their lengths; both sides of each must be the same line in space. */
static double find(struct sheets *s, bool backs)
{
    const uint32_t objects = (uint32_t)s->f->scene.object_count;
    double sum = 0.0;
    s->surface = (struct kiln_surface){.object_count = objects,
                                       .whole_maps = backs ? 2 * objects : objects,
                                       .map_count = backs ? 2 * objects : objects,
                                       .lightmaps = s->lightmaps};
    for (uint32_t i = 0; backs && i < objects; i++)
        s->lightmaps[objects + i] = s->lightmaps[i];
    assert_int_equal(kiln_joints_find(&s->joints, &s->f->scene, &s->surface, 4.0, NULL), KILN_OK);
    for (size_t i = 0; i < s->joints->count; i++) {
        const struct kiln_joint *joint = &s->joints->joints[i];
        double at[2][2][3], square = 0.0;
        for (int side = 0; side < 2; side++)
            for (int e = 0; e < 2; e++)
                place_of(s, joint->map[side], joint->edge.texel[side][e], at[side][e]);
        for (int e = 0; e < 2; e++)
            for (int c = 0; c < 3; c++)
                assert_true(fabs(at[0][e][c] - at[1][e][c]) < 1e-5);
        for (int c = 0; c < 3; c++)
            square += (at[0][1][c] - at[0][0][c]) * (at[0][1][c] - at[0][0][c]);
        sum += sqrt(square);
        assert_true(joint->map[0] < joint->map[1]);
        assert_true(s->joints->group[joint->map[0]] == s->joints->group[joint->map[1]]);
    }
    return sum;
}

static void end(struct sheets *s)
{
    kiln_joints_destroy(&s->joints);
    fixture_destroy(s->f);
}

static const double here[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static void surfaces_go_on(void **state)
{
    (void)state;
    const double beside[12] = {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0}, turned[12] = {0, 1, 0, 1, -1, 0, 0, 1, 0, 0, 1, 0},
                 mirrored[12] = {-1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 1, 0},
                 below[12] = {2, 0, 0, 0, 0, 1, 0, -1, 0, 0, 1, 0},
                 half_way[12] = {1, 0, 0, 1, 0, 1, 0, 0.25, 0, 0, 1, 0};
    const struct {
        const double *second, *third;
        double length;
    } cases[] = {{beside, NULL, 1.0}, {turned, NULL, 1.0},    {mirrored, NULL, 1.0},
                 {below, NULL, 1.0},  {half_way, NULL, 0.75}, {beside, below, 3.0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sheets s = begin(false);
        add_sheet(&s, 3, here);
        add_sheet(&s, 2, cases[i].second);
        if (cases[i].third != NULL)
            add_sheet(&s, 5, cases[i].third);
        const double length = find(&s, false);
        printf("case %zu: %zu joints of %.6f m together\n", i, s.joints->count, length);
        assert_true(fabs(length - cases[i].length) < 1e-5);
        assert_int_equal(s.joints->group[0], 0);
        end(&s);
    }
}

static void surfaces_do_not_go_on(void **state)
{
    (void)state;
    const double apart[12] = {1, 0, 0, 1.001, 0, 1, 0, 0, 0, 0, 1, 0},
                 step[12] = {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0.001},
                 upright[12] = {0, 0, -1, 1, 0, 1, 0, 0, 1, 0, 0, 0},
                 tilted[12] = {0.99, 0, -0.14, 1, 0, 1, 0, 0, 0.14, 0, 0.99, 0},
                 reversed[12] = {-1, 0, 0, 1, 0, 1, 0, 0, 0, 0, -1, 0},
                 over[12] = {-1, 0, 0, 2, 0, 1, 0, 0, 0, 0, -1, 0}, across[12] = {1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 0};
    const double *cases[] = {apart, step, upright, tilted, reversed, over, here, across};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sheets s = begin(false);
        add_sheet(&s, 3, here);
        add_sheet(&s, 3, cases[i]);
        assert_true(find(&s, false) == 0.0);
        assert_int_equal(s.joints->count, 0);
        assert_int_equal(s.joints->group[0], KILN_NONE);
        end(&s);
    }
}

/* Backs go on in backs, and in the front of a sheet that is turned over. Not published lightmaps have none. */
static void backs_and_unpublished(void **state)
{
    (void)state;
    const double beside[12] = {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0}, over[12] = {-1, 0, 0, 2, 0, 1, 0, 0, 0, 0, -1, 0};
    for (int turned = 0; turned < 2; turned++) {
        struct sheets s = begin(true);
        add_sheet(&s, 1, here);
        add_sheet(&s, 1, turned != 0 ? over : beside);
        assert_true(fabs(find(&s, true) - 2.0) < 1e-5);
        assert_int_equal(s.joints->group[1], turned != 0 ? 1 : 0);
        assert_int_equal(s.joints->group[3], turned != 0 ? 0 : 2);
        kiln_joints_destroy(&s.joints);
        s.lightmaps[1].published = 0;
        assert_true(fabs(find(&s, false)) == 0.0);
        end(&s);
    }
}

/* The tiles that are ghosts: those near the common edge, which is v = 0.9 of the first sheet and 0.1 of the second. */
static void tiles_beside_a_joint(void **state)
{
    (void)state;
    const double beside[12] = {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0};
    struct sheets s = begin(false);
    struct kiln_ghosts *ghosts = NULL;
    add_sheet(&s, 3, here);
    add_sheet(&s, 4, beside);
    assert_true(find(&s, false) > 0.0);
    assert_int_equal(kiln_ghosts_create(&ghosts, s.joints, &s.surface, NULL), KILN_OK);
    for (uint32_t map = 0; map < 2; map++)
        for (uint32_t tile = 0; tile < 16; tile++) {
            const uint32_t row = tile / 4; /* the edge lies at row 28.8 or 3.2, all but 0.1 of the width along */
            size_t first = 0;
            const size_t count = kiln_ghosts_of(ghosts, map, tile, &first);
            const bool far = map == 0 ? row == 0 : row == 3;
            assert_int_equal(count, far ? 0 : 1);
            assert_true(far || ghosts->tiles[first].to == 1 - map);
        }
    assert_int_equal(kiln_ghosts_of(NULL, 0, 0, NULL), 0);
    kiln_ghosts_destroy(&ghosts);
    end(&s);
}

/* Every edge near another is visited, and no other. */
static void count_visits(void *context, size_t number)
{
    uint8_t *visited = context;
    visited[number]++;
}

static void all_edges_are_found(void **state)
{
    (void)state;
    enum { EDGES = 700 };
    struct kiln_edge edges[EDGES];
    struct kiln_edge_tree *tree = NULL;
    struct fixture *f = fixture_create();
    for (int i = 0; i < EDGES; i++)
        for (int c = 0; c < 3; c++) {
            edges[i].end[0][c] = (float)fixture_random(f);
            edges[i].end[1][c] = edges[i].end[0][c] + 0.1f * (float)fixture_random(f);
        }
    assert_int_equal(kiln_edge_tree_create(&tree, edges, EDGES, NULL), KILN_OK);
    for (int i = 0; i < EDGES; i++) {
        uint8_t visited[EDGES] = {0};
        kiln_edge_tree_visit(tree, &edges[i], 0.01f, count_visits, visited);
        for (int j = 0; j < EDGES; j++) {
            bool near = true;
            for (int c = 0; c < 3; c++)
                near = near && edges[j].end[0][c] <= edges[i].end[1][c] + 0.01f &&
                       edges[j].end[1][c] >= edges[i].end[0][c] - 0.01f;
            assert_int_equal(visited[j], near ? 1 : 0);
        }
    }
    kiln_edge_tree_destroy(&tree);
    fixture_destroy(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(surfaces_go_on), cmocka_unit_test(surfaces_do_not_go_on),
                                       cmocka_unit_test(backs_and_unpublished), cmocka_unit_test(tiles_beside_a_joint),
                                       cmocka_unit_test(all_edges_are_found)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
