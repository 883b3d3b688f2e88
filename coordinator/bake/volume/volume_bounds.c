#include "coordinator/bake/volume/volume_bounds.h"

#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>
#include <strings.h>

#include "worker/base/memory.h"

struct box {
    double low[3], high[3];
};

enum role { RECEIVER, CASTER, SOURCE };

/* Scenes with more vertices over all objects get boxes from the corners of the meshes' boxes. */
static const uint64_t EXACT_VERTICES = 1u << 24;

static const struct box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static struct box add(struct box a, const struct box *b)
{
    for (int k = 0; k < 3; k++) {
        a.low[k] = fmin(a.low[k], b->low[k]);
        a.high[k] = fmax(a.high[k], b->high[k]);
    }
    return a;
}

static double longest_side(const struct box *box)
{
    return fmax(box->high[0] - box->low[0], fmax(box->high[1] - box->low[1], box->high[2] - box->low[2]));
}

/* Points that represent a mesh: its vertices or, in scenes with very many, the corners of its box. */
struct outline {
    const struct kiln_vec3 *points;
    uint64_t count;
    struct kiln_vec3 corners[8];
};

static void take_corners(struct outline *outline)
{
    struct kiln_vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
    for (uint64_t i = 0; i < outline->count; i++) {
        const struct kiln_vec3 v = outline->points[i];
        low = vec3(fminf(low.x, v.x), fminf(low.y, v.y), fminf(low.z, v.z));
        high = vec3(fmaxf(high.x, v.x), fmaxf(high.y, v.y), fmaxf(high.z, v.z));
    }
    for (unsigned k = 0; k < 8; k++)
        outline->corners[k] =
            vec3((k & 1u) != 0 ? high.x : low.x, (k & 2u) != 0 ? high.y : low.y, (k & 4u) != 0 ? high.z : low.z);
    if (outline->count > 0) {
        outline->points = outline->corners;
        outline->count = 8;
    }
}

static int find_outlines(struct outline **outlines, const struct kiln_scene *scene, struct kiln_error *error)
{
    uint64_t work = 0;
    for (size_t i = 0; i < scene->object_count; i++)
        work += scene->meshes[scene->objects[i].mesh].vertex_count;
    const int status = kiln_allocate(outlines, scene->mesh_count, sizeof **outlines, "the objects' bounds", error);
    for (size_t i = 0; i < scene->mesh_count && status == KILN_OK; i++) {
        struct outline *outline = &(*outlines)[i];
        outline->points = scene->positions + scene->meshes[i].vertex_first;
        outline->count = scene->meshes[i].vertex_count;
        if (work > EXACT_VERTICES)
            take_corners(outline);
    }
    return status;
}

static struct box box_of(const struct outline *outline, const double transform[12])
{
    struct box box = nothing;
    for (uint64_t i = 0; i < outline->count; i++) {
        const struct kiln_vec3 v = outline->points[i];
        for (int k = 0; k < 3; k++) {
            const double *m = transform + 4 * k,
                         x = m[0] * (double)v.x + m[1] * (double)v.y + m[2] * (double)v.z + m[3];
            box.low[k] = fmin(box.low[k], x);
            box.high[k] = fmax(box.high[k], x);
        }
    }
    return box;
}

/* Whether the word at `at` is "sky", or a compound such as "skydome". */
static bool is_sky(const char *at)
{
    static const char *const words[] = {"sky",    "skydome", "skybox", "skysphere",  "skyball",
                                        "skymap", "skymesh", "skymat", "skymaterial"};
    size_t length = 0;
    while (isalpha((unsigned char)at[length]))
        length++;
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strlen(words[i]) == length && strncasecmp(at, words[i], length) == 0)
            return true;
    return false;
}

static bool names_a_sky(const char *name)
{
    for (const char *at = name; *at != '\0'; at++)
        if ((at == name || !isalpha((unsigned char)at[-1])) && is_sky(at))
            return true;
    return false;
}

static bool is_black(const struct kiln_material *m)
{
    return m->base_color[0] == 0.0f && m->base_color[1] == 0.0f && m->base_color[2] == 0.0f && m->transmission == 0.0f;
}

static bool emits(const struct kiln_material *m)
{
    return m->emission[0] > 0.0f || m->emission[1] > 0.0f || m->emission[2] > 0.0f;
}

/* Whether a mesh is a source of light only: all its materials are black, or all emit, or it or a material is named a
 * sky. */
static bool is_source(const struct kiln_scene *scene, const struct kiln_mesh *mesh)
{
    bool black = true, lit = true;
    uint32_t last = KILN_NONE;
    for (uint64_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t m = scene->triangle_materials[mesh->triangle_first + t];
        if (m == last)
            continue;
        last = m;
        black = black && is_black(&scene->materials[m]);
        lit = lit && emits(&scene->materials[m]);
        if (names_a_sky(kiln_scene_string(scene, scene->materials[m].name)))
            return true;
    }
    return black || lit || names_a_sky(kiln_scene_string(scene, mesh->name));
}

/* Finds the role of each object for the bounds. */
static int find_roles(uint8_t **roles, const struct kiln_scene *scene, size_t counts[3], struct kiln_error *error)
{
    uint8_t *sources = NULL;
    int status;
    KILN_TRY(kiln_allocate(roles, scene->object_count, 1, "the objects' bounds", error));
    KILN_TRY(kiln_allocate(&sources, scene->mesh_count, 1, "the objects' bounds", error));
    for (size_t i = 0; i < scene->mesh_count; i++)
        sources[i] = is_source(scene, &scene->meshes[i]);
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct kiln_object *o = &scene->objects[i];
        const bool source = sources[o->mesh] != 0 || names_a_sky(kiln_scene_string(scene, o->original_name));
        (*roles)[i] = source ? SOURCE : (o->flags & KILN_OBJECT_CASTER_ONLY) != 0 ? CASTER : RECEIVER;
        counts[(*roles)[i]]++;
    }
end:
    kiln_free(&sources);
    return status;
}

static void take_scene(struct kiln_volume_bounds *bounds, const struct kiln_scene *scene)
{
    memcpy(bounds->low, scene->header->bounds_min, sizeof bounds->low);
    memcpy(bounds->high, scene->header->bounds_max, sizeof bounds->high);
}

/* Adds to the box of the rest the sources that do not make it too long, each by itself. */
static void add_sources(struct kiln_volume_bounds *bounds, struct box *box, const struct box *boxes,
                        const uint8_t *roles, size_t count)
{
    const struct box rest = *box;
    for (size_t i = 0; i < count; i++) {
        const struct box both = add(rest, &boxes[i]);
        const double longest = longest_side(&boxes[i]);
        if (roles[i] != SOURCE || !(longest >= 0.0))
            continue;
        if (longest_side(&both) <= KILN_VOLUME_SOURCE * longest_side(&rest)) {
            *box = add(*box, &boxes[i]);
            continue;
        }
        bounds->left_out++;
        if (longest > bounds->longest || bounds->largest == KILN_NONE) {
            bounds->largest = (uint32_t)i;
            bounds->longest = longest;
        }
    }
}

static int find_among(struct kiln_volume_bounds *bounds, const struct kiln_scene *scene, const uint8_t *roles,
                      const size_t counts[3], struct kiln_error *error)
{
    const enum role kept = counts[RECEIVER] > 0 ? RECEIVER : CASTER;
    struct outline *outlines = NULL;
    struct box *boxes = NULL, box = nothing;
    int status;
    KILN_TRY(kiln_allocate(&boxes, scene->object_count, sizeof *boxes, "the objects' bounds", error));
    KILN_TRY(find_outlines(&outlines, scene, error));
    for (size_t i = 0; i < scene->object_count; i++) {
        boxes[i] = box_of(&outlines[scene->objects[i].mesh], scene->objects[i].transform);
        if (roles[i] == kept)
            box = add(box, &boxes[i]);
    }
    if (longest_side(&box) > 0.0) {
        add_sources(bounds, &box, boxes, roles, scene->object_count);
        memcpy(bounds->low, box.low, sizeof bounds->low);
        memcpy(bounds->high, box.high, sizeof bounds->high);
    }
end:
    if (bounds->left_out == 0 && (counts[CASTER] == 0 || kept == CASTER))
        take_scene(bounds, scene);
    kiln_free(&outlines);
    kiln_free(&boxes);
    return status;
}

int kiln_volume_bounds_find(struct kiln_volume_bounds *bounds, const struct kiln_scene *scene, struct kiln_error *error)
{
    uint8_t *roles = NULL;
    size_t counts[3] = {0};
    *bounds = (struct kiln_volume_bounds){.largest = KILN_NONE};
    take_scene(bounds, scene);
    int status = find_roles(&roles, scene, counts, error);
    if (status == KILN_OK && (counts[SOURCE] > 0 || counts[CASTER] > 0) && counts[RECEIVER] + counts[CASTER] > 0)
        status = find_among(bounds, scene, roles, counts, error);
    kiln_free(&roles);
    return status;
}
