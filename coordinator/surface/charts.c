#include "coordinator/surface/charts.h"

#include <string.h>

#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

struct vertex_key {
    uint32_t words[5];
};

/* Position and lightmap coordinate, comparable with memcmp. */
static struct vertex_key key_of(const struct kiln_scene *scene, uint64_t vertex)
{
    /* adding 0 makes -0 equal to 0 */
    const struct kiln_vec3 p = scene->positions[vertex];
    const struct kiln_vec2 t = scene->texcoord_lightmap[vertex];
    const float values[5] = {p.x + 0.0f, p.y + 0.0f, p.z + 0.0f, t.x + 0.0f, t.y + 0.0f};
    struct vertex_key key;
    memcpy(key.words, values, sizeof key.words);
    return key;
}

static uint64_t hash_of(const struct vertex_key *key)
{
    uint64_t h = 0x9e3779b97f4a7c15u;
    for (int i = 0; i < 5; i++) {
        h = (h ^ key->words[i]) * 0xff51afd7ed558ccdu;
        h ^= h >> 32;
    }
    return h;
}

/* Joins vertices with equal position and equal lightmap coordinate: such vertices were duplicated only for their
 * normals, colours or materials. */
static int join_equal(uint32_t *parent, const struct kiln_scene *scene, const struct kiln_mesh *mesh,
                      struct kiln_error *error)
{
    uint64_t slots = 16;
    while (slots < 2 * mesh->vertex_count)
        slots *= 2;
    uint32_t *table = NULL; /* vertex + 1; 0: empty */
    const int status = kiln_allocate(&table, slots, sizeof *table, "the charts of a mesh", error);
    if (status != KILN_OK)
        return status;
    for (uint64_t v = 0; v < mesh->vertex_count; v++) {
        const struct vertex_key key = key_of(scene, mesh->vertex_first + v);
        uint64_t slot = hash_of(&key) & (slots - 1);
        for (; table[slot] != 0; slot = (slot + 1) & (slots - 1)) {
            const struct vertex_key other = key_of(scene, mesh->vertex_first + table[slot] - 1);
            if (memcmp(&key, &other, sizeof key) == 0)
                break;
        }
        if (table[slot] == 0)
            table[slot] = (uint32_t)v + 1;
        else
            kiln_sets_join(parent, (uint32_t)v, table[slot] - 1);
    }
    kiln_free(&table);
    return KILN_OK;
}

static int find_in_mesh(uint32_t *parent, const struct kiln_scene *scene, const struct kiln_mesh *mesh,
                        struct kiln_error *error)
{
    for (uint64_t v = 0; v < mesh->vertex_count; v++)
        parent[v] = (uint32_t)v;
    const int status = join_equal(parent, scene, mesh, error);
    if (status != KILN_OK)
        return status;
    for (uint64_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *corner = scene->triangles + 3 * (mesh->triangle_first + t);
        kiln_sets_join(parent, corner[0], corner[1]);
        kiln_sets_join(parent, corner[0], corner[2]);
    }
    for (uint64_t v = 0; v < mesh->vertex_count; v++)
        parent[v] = kiln_sets_root(parent, (uint32_t)v);
    return KILN_OK;
}

int kiln_charts_find(uint32_t **vertex_chart, const struct kiln_scene *scene, const uint8_t *wanted, uint32_t threads,
                     struct kiln_error *error)
{
    *vertex_chart = NULL;
    uint32_t *chart = NULL;
    int status = kiln_allocate(&chart, scene->vertex_count, sizeof *chart, "the charts of the scene", error);
    if (status != KILN_OK)
        return status;
    const int team = (int)threads;
#pragma omp parallel for schedule(dynamic) num_threads(team)
    for (size_t m = 0; m < scene->mesh_count; m++) {
        struct kiln_error own;
        if (wanted != NULL && !wanted[m])
            continue;
        const int failed = find_in_mesh(chart + scene->meshes[m].vertex_first, scene, &scene->meshes[m], &own);
        if (failed != KILN_OK) {
#pragma omp critical(kiln_charts_failure)
            {
                status = failed;
                if (error != NULL)
                    *error = own;
            }
        }
    }
    if (status == KILN_OK) {
        *vertex_chart = chart;
        chart = NULL;
    }
    kiln_free(&chart);
    return status;
}
