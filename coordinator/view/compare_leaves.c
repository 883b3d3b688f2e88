#include "coordinator/view/compare_leaves.h"

#include <string.h>

#include "coordinator/view/leaf_light.h"
#include "worker/base/memory.h"
#include "worker/scene/leaves.h"

struct kiln_compared_leaves {
    const struct kiln_scene *scene;
    struct kiln_geometry *geometry;
    struct kiln_leaf_light *light;
    uint64_t *first; /* where an object's triangles begin in `world` */
    uint32_t *world; /* numbers of world triangles, by object and in the order of its mesh */
    bool alone;
};

static int number_triangles(struct kiln_compared_leaves *l, struct kiln_error *error)
{
    const struct kiln_scene *scene = l->scene;
    const struct kiln_geometry *g = l->geometry;
    size_t sum = 0;
    int status;
    KILN_TRY(kiln_allocate(&l->first, scene->object_count, sizeof *l->first, "triangles to compare", error));
    for (size_t i = 0; i < scene->object_count; i++) {
        l->first[i] = sum;
        sum += scene->meshes[scene->objects[i].mesh].triangle_count;
    }
    KILN_TRY(kiln_allocate(&l->world, sum, sizeof *l->world, "triangles to compare", error));
    for (uint32_t t = 0; t < g->triangle_count; t++) {
        const uint32_t object = g->records[t].object;
        const struct kiln_mesh *mesh = &scene->meshes[scene->objects[object].mesh];
        l->world[l->first[object] + g->stored_triangle[t] - mesh->triangle_first] = t;
    }
end:
    return status;
}

/* Reads the size of leaves from run.json; 0: there are none. */
static int find_size(struct kiln_results *results, double *size, struct kiln_error *error)
{
    json_t *run = NULL;
    *size = 0.0;
    if (!kiln_results_has(results, "run.json"))
        return KILN_OK;
    const int status = kiln_results_json(results, "run.json", &run, error);
    const json_t *store = json_object_get(run, "store"), *kind = json_object_get(store, "kind");
    if (status == KILN_OK && json_is_string(kind) && strcmp(json_string_value(kind), "octree") == 0)
        *size = json_number_value(json_object_get(store, "leaf_size"));
    json_decref(run);
    return status;
}

int kiln_compared_leaves_open(struct kiln_compared_leaves **leaves, struct kiln_results *results,
                              const struct kiln_scene *scene, const char *directory, struct kiln_error *error)
{
    double size;
    *leaves = NULL;
    int status = find_size(results, &size, error);
    if (status != KILN_OK || !(size > 0.0))
        return status;
    status = kiln_allocate(leaves, 1, sizeof **leaves, "an octree's leaves", error);
    if (status != KILN_OK)
        return status;
    (*leaves)->scene = scene;
    status = kiln_geometry_create(&(*leaves)->geometry, scene, error);
    if (status == KILN_OK)
        status = kiln_leaves_lay((*leaves)->geometry, size, error);
    if (status == KILN_OK)
        status = number_triangles(*leaves, error);
    const struct kiln_view_source source = {
        .directory = directory, .results = results, .scene = scene, .geometry = (*leaves)->geometry};
    if (status == KILN_OK)
        status = kiln_leaf_light_create(&(*leaves)->light, &source, error);
    if (status != KILN_OK)
        kiln_compared_leaves_close(leaves);
    return status;
}

void kiln_compared_leaves_close(struct kiln_compared_leaves **leaves)
{
    if (*leaves == NULL)
        return;
    kiln_leaf_light_destroy(&(*leaves)->light);
    kiln_geometry_destroy(&(*leaves)->geometry);
    kiln_free(&(*leaves)->first);
    kiln_free(&(*leaves)->world);
    kiln_free(leaves);
}

bool kiln_compared_leaves_same(const struct kiln_compared_leaves *a, const struct kiln_compared_leaves *b, bool light)
{
    const struct kiln_geometry *g = a->geometry, *h = b->geometry;
    return memcmp(&g->leaf_size, &h->leaf_size, sizeof g->leaf_size) == 0 &&
           memcmp(&g->leaf_origin, &h->leaf_origin, sizeof g->leaf_origin) == 0 &&
           kiln_leaf_light_same(a->light, b->light, light);
}

void kiln_compared_leaves_alone(struct kiln_compared_leaves *leaves) { leaves->alone = true; }

bool kiln_compared_leaves_at(const struct kiln_compared_leaves *l, uint32_t object, uint64_t k, double b1, double b2,
                             float rgb[3])
{
    const bool flipped = l->scene->objects[object].flipped != 0;
    const struct kiln_hit hit = {
        .triangle = l->world[l->first[object] + k], .u = (float)(flipped ? b2 : b1), .v = (float)(flipped ? b1 : b2)};
    return l->alone ? kiln_leaf_light_in(l->light, l->geometry, &hit, rgb)
                    : kiln_leaf_light_at(l->light, l->geometry, &hit, false, rgb);
}
