#include "worker/scene/enclosures.h"

#include <math.h>

#include "worker/base/memory.h"

struct bounds {
    struct kiln_vec3 low, high; /* relative to the scene's centre; low.x > high.x: it has no triangle */
};

enum answer { UNKNOWN, EMPTY, FULL };

struct kiln_enclosures {
    const struct kiln_scene *scene;
    struct bounds *bounds; /* of each object */
    uint8_t *answers;      /* enum answer */
};

static void add_corner(struct bounds *b, const float *p)
{
    b->low = (struct kiln_vec3){fminf(b->low.x, p[0]), fminf(b->low.y, p[1]), fminf(b->low.z, p[2])};
    b->high = (struct kiln_vec3){fmaxf(b->high.x, p[0]), fmaxf(b->high.y, p[1]), fmaxf(b->high.z, p[2])};
}

int kiln_enclosures_create(struct kiln_enclosures **enclosures, const struct kiln_scene *scene,
                           const struct kiln_geometry *geometry, struct kiln_error *error)
{
    struct kiln_enclosures *e = NULL;
    int status;
    KILN_TRY(kiln_allocate(&e, 1, sizeof *e, "the bounds of objects", error));
    KILN_TRY(kiln_allocate(&e->bounds, scene->object_count, sizeof *e->bounds, "the bounds of objects", error));
    KILN_TRY(kiln_allocate(&e->answers, scene->object_count, sizeof *e->answers, "the bounds of objects", error));
end:
    *enclosures = e;
    if (status != KILN_OK) {
        kiln_enclosures_destroy(enclosures);
        return status;
    }
    e->scene = scene;
    for (size_t i = 0; i < scene->object_count; i++)
        e->bounds[i] = (struct bounds){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t t = 0; t < geometry->triangle_count; t++)
        for (int c = 0; c < 3; c++)
            add_corner(&e->bounds[geometry->records[t].object],
                       geometry->vertices + 3 * (size_t)geometry->indices[3 * t + (size_t)c]);
    return KILN_OK;
}

void kiln_enclosures_destroy(struct kiln_enclosures **enclosures)
{
    if (*enclosures == NULL)
        return;
    kiln_free(&(*enclosures)->bounds);
    kiln_free(&(*enclosures)->answers);
    kiln_free(enclosures);
}

static bool has(const struct bounds *b, struct kiln_vec3 p)
{
    return p.x > b->low.x && p.x < b->high.x && p.y > b->low.y && p.y < b->high.y && p.z > b->low.z && p.z < b->high.z;
}

static bool has_place(const struct kiln_enclosures *e, const struct bounds *b, const double position[3])
{
    const double *centre = e->scene->header->centre;
    const struct kiln_vec3 p = {(float)(position[0] - centre[0]), (float)(position[1] - centre[1]),
                                (float)(position[2] - centre[2])};
    return has(b, p);
}

static bool look(const struct kiln_enclosures *e, uint32_t object)
{
    const struct kiln_scene *s = e->scene;
    const struct bounds *b = &e->bounds[object];
    bool full = s->object_count == 1;
    for (uint32_t i = 0; i < s->object_count && !full; i++)
        full = i != object && e->bounds[i].low.x <= e->bounds[i].high.x &&
               has(b, vec3_scale(vec3_add(e->bounds[i].low, e->bounds[i].high), 0.5f));
    for (size_t i = 0; i < s->light_count && !full; i++)
        full = s->lights[i].kind != KILN_LIGHT_DIRECTIONAL && has_place(e, b, s->lights[i].position);
    for (size_t i = 0; i < s->camera_count && !full; i++)
        full = has_place(e, b, s->cameras[i].position);
    return full;
}

bool kiln_encloses(struct kiln_enclosures *enclosures, uint32_t object)
{
    uint8_t *answer = &enclosures->answers[object];
    if (*answer == UNKNOWN)
        *answer = look(enclosures, object) ? FULL : EMPTY;
    return *answer == FULL;
}
