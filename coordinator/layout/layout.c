#include "coordinator/layout/layout.h"

#include <stdlib.h>
#include <string.h>

#include "coordinator/layout/density.h"
#include "coordinator/layout/padding.h"
#include "coordinator/layout/sharing.h"
#include "coordinator/layout/unwrap.h"
#include "coordinator/layout/uv_check.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { DEFAULT_MAX = 4096, DEFAULT_PADDING = 2, LARGEST_SIDE = 1 << 16, NOTES_MAX = 16 };
/* most texels of all lightmaps that settings in the file itself may cause: 2^25 or, if the user gives a density or a
 * size, OWN_TIMES the number without these settings */
static const double OWN_TEXELS = 33554432.0, OWN_TIMES = 16.0;
static const double SCENE_TEXELS = 262144.0; /* default of texels of the whole scene with automatic density */
/* fraction of a lightmap that one of kiln's layouts fills; assumed until it is made */
static const double EXPECTED_USE = 0.7;
/* 2^20: texels of the whole scene, at most, when densities are raised so that charts lie further apart */
#define PADDED 4.0 /* times as many texels at most, where charts need distance */
/* fraction of a layout's chart borders that may lie nearer than two texels to another chart */
static const double CLOSE_FRACTION = 0.01;
/* fraction of shared texels that is accepted in a back's lightmap, since avoiding them costs four times as many
 * texels */
static const double SHARED_OF_BACKS = 1e-4;
/* ground: limit of its height relative to its longest side; least width and length relative to all other objects; least
 * longest side, m */
static const double GROUND_FLAT = 0.02, GROUND_SPREAD = 4.0, GROUND_LEAST = 100.0;
static const double RAISE_MAX = 4.0; /* largest factor by which a density is raised for that purpose */
/* factor on the density of a caster-only object, whose lightmap is not seen */
static const double CASTER_FACTOR = 0.25;

/* Measure of an object for its lightmap: its area in the world, m2, and the metres that a unit of u and of v spans
 * (area-weighted means). */
struct measure {
    double area, along_u, along_v;
};

/* The measure of the last shape that a mesh was given by a transform. Rotating an object changes nothing, and scaling
 * it evenly only scales the measure, so a thousand copies are measured once. */
struct shape {
    bool known;
    double metric[6]; /* metric tensor of the transform, divided by its trace */
    struct measure measure;
};

struct sized_padding {
    double width, height; /* texels */
    struct kiln_padding padding;
};

/* Decisions on a mesh's layout. */
struct mesh_plan {
    bool unwrap; /* a layout is made: by unwrapping, or by repacking given charts */
    bool repack;
    bool parted;      /* repacked because charts shared texels */
    size_t reference; /* the mesh's object with the most texels, for which it is unwrapped; SIZE_MAX: none */
    struct kiln_unwrapped *unwrapped;
    struct measure measure; /* of the reference object, in the new layout */
    struct shape shape;
    double use;                     /* fraction of the lightmap that the layout fills */
    double density;                 /* density for which the layout was made */
    bool sized;                     /* the layout was made for a given size, and the density is a result */
    struct sized_padding *paddings; /* one per lightmap size at which the padding of the layout was measured */
    size_t padding_count, padding_capacity;
    double metres[2]; /* repack: metres that a unit of u and of v of the file's layout spans on the reference object */
};

struct planner {
    struct kiln_builder *builder;
    struct kiln_layout_params params;
    double texels_per_metre;
    struct mesh_plan *plans;     /* one per mesh */
    struct measure *measures;    /* one per object, in the file's layout */
    struct kiln_density density; /* automatic */
    double *densities;           /* per object: its texels a metre */
    uint64_t *source;            /* per new vertex: the old vertex it copies (index among all meshes' vertices) */
    struct kiln_vec2 *uv;
    size_t vertex_count, source_capacity, uv_capacity;
    size_t ground;                                             /* ground object around all others; SIZE_MAX: none */
    size_t absent, refused, unclean, capped, shared, repacked; /* counts for notes */
    /* meshes whose charts share texels: their number, the one with the most shared texels in a lightmap, and that
     * number of texels */
    size_t parted, most_shared_mesh;
    uint64_t most_shared;
    uint32_t most_shared_size[2]; /* that lightmap's sides, texels */
    struct kiln_arena arena;
};

static struct kiln_mesh *meshes(const struct planner *p)
{
    return KILN_BUILDER_DATA(p->builder, struct kiln_mesh, KILN_SECTION_MESHES);
}
static size_t mesh_count(const struct planner *p) { return p->builder->sections[KILN_SECTION_MESHES].count; }
static struct kiln_object *objects(const struct planner *p)
{
    return KILN_BUILDER_DATA(p->builder, struct kiln_object, KILN_SECTION_OBJECTS);
}
static size_t object_count(const struct planner *p) { return p->builder->sections[KILN_SECTION_OBJECTS].count; }
static const struct kiln_vec3 *positions(const struct planner *p, const struct kiln_mesh *mesh)
{
    return KILN_BUILDER_DATA(p->builder, struct kiln_vec3, KILN_SECTION_POSITIONS) + mesh->vertex_first;
}
static struct kiln_vec2 *lightmap_uv(const struct planner *p, const struct kiln_mesh *mesh)
{
    return KILN_BUILDER_DATA(p->builder, struct kiln_vec2, KILN_SECTION_TEXCOORD_LIGHTMAP) + mesh->vertex_first;
}
static uint32_t *triangles(const struct planner *p, const struct kiln_mesh *mesh)
{
    return KILN_BUILDER_DATA(p->builder, uint32_t, KILN_SECTION_TRIANGLES) + 3 * mesh->triangle_first;
}
static const struct kiln_object_settings *settings_of(const struct planner *p, size_t object)
{
    return &p->builder->object_settings[object];
}
static const char *string(const struct planner *p, uint32_t offset)
{
    return KILN_BUILDER_DATA(p->builder, char, KILN_SECTION_STRINGS) + offset;
}

static void linear_part(const double transform[12], double linear[9])
{
    for (size_t row = 0; row < 3; row++)
        for (size_t column = 0; column < 3; column++)
            linear[3 * row + column] = transform[4 * row + column];
}

static struct kiln_dvec3 apply(const double m[9], struct kiln_dvec3 p)
{
    return dvec3(m[0] * p.x + m[1] * p.y + m[2] * p.z, m[3] * p.x + m[4] * p.y + m[5] * p.z,
                 m[6] * p.x + m[7] * p.y + m[8] * p.z);
}

/* Area-weighted mean lengths of dP/du and dP/dv over the triangles that have an extent in the layout. `uv` may be
 * NULL. */
static struct measure measure_triangles(const struct kiln_vec3 *points, const struct kiln_vec2 *uv,
                                        const uint32_t *corners, size_t count, const double linear[9])
{
    struct measure m = {0};
    double weight = 0.0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t *c = corners + 3 * i;
        const struct kiln_dvec3 origin = dvec3_of(points[c[0]]);
        const struct kiln_dvec3 a = apply(linear, dvec3_sub(dvec3_of(points[c[1]]), origin));
        const struct kiln_dvec3 b = apply(linear, dvec3_sub(dvec3_of(points[c[2]]), origin));
        const double area = 0.5 * dvec3_length(dvec3_cross(a, b));
        m.area += area;
        if (uv == NULL)
            continue;
        const double au = (double)uv[c[1]].x - (double)uv[c[0]].x, av = (double)uv[c[1]].y - (double)uv[c[0]].y;
        const double bu = (double)uv[c[2]].x - (double)uv[c[0]].x, bv = (double)uv[c[2]].y - (double)uv[c[0]].y;
        const double determinant = au * bv - av * bu;
        if (determinant == 0.0)
            continue;
        weight += area;
        m.along_u += area * dvec3_length(dvec3_sub(dvec3_scale(a, bv), dvec3_scale(b, av))) / fabs(determinant);
        m.along_v += area * dvec3_length(dvec3_sub(dvec3_scale(b, au), dvec3_scale(a, bu))) / fabs(determinant);
    }
    if (weight > 0.0) {
        m.along_u /= weight;
        m.along_v /= weight;
    }
    return m;
}

/* The transform's metric tensor divided by its trace. Returns the square root of the trace. */
static double shape_metric(const double m[9], double metric[6])
{
    static const int pairs[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    for (int i = 0; i < 6; i++) {
        const int a = pairs[i][0], b = pairs[i][1];
        metric[i] = m[a] * m[b] + m[3 + a] * m[3 + b] + m[6 + a] * m[6 + b];
    }
    const double trace = metric[0] + metric[1] + metric[2];
    for (int i = 0; i < 6 && trace > 0.0; i++)
        metric[i] /= trace;
    return sqrt(trace);
}

static struct measure measure_shape(struct shape *shape, const struct kiln_vec3 *points, const struct kiln_vec2 *uv,
                                    const uint32_t *corners, size_t count, const double transform[12])
{
    double linear[9], metric[6];
    linear_part(transform, linear);
    const double scale = shape_metric(linear, metric);
    if (!(scale > 0.0) || !isfinite(scale))
        return (struct measure){0};
    bool same = shape->known;
    for (int i = 0; i < 6; i++)
        same = same && fabs(metric[i] - shape->metric[i]) <= 1e-9;
    if (!same) {
        for (int i = 0; i < 9; i++)
            linear[i] /= scale;
        shape->known = true;
        memcpy(shape->metric, metric, sizeof metric);
        shape->measure = measure_triangles(points, uv, corners, count, linear);
    }
    const struct measure m = shape->measure;
    return (struct measure){m.area * scale * scale, m.along_u * scale, m.along_v * scale};
}

/* Counts a note of a kind that may occur very often; true for the first few, which are written out. */
static bool note_wanted(size_t *count) { return (*count)++ < NOTES_MAX; }

static int check_mesh(struct planner *p, size_t index, struct kiln_error *error)
{
    struct kiln_mesh *mesh = &meshes(p)[index];
    struct mesh_plan *plan = &p->plans[index];
    static const double identity[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
    mesh->surface_area =
        measure_triangles(positions(p, mesh), NULL, triangles(p, mesh), mesh->triangle_count, identity).area;
    const bool has_any = index < p->builder->mesh_capacity &&
                         p->builder->mesh_has_lightmap_uv[index] != KILN_LIGHTMAP_UV_NONE,
               sound = has_any && p->builder->mesh_has_lightmap_uv[index] == KILN_LIGHTMAP_UV_SOUND;
    const double known_area = mesh->uv_area;
    mesh->uv_area = 0.0;
    plan->reference = SIZE_MAX;
    plan->use = EXPECTED_USE;
    plan->unwrap = mesh->triangle_count > 0;
    if (mesh->triangle_count == 0)
        return KILN_OK;
    if (!has_any) {
        p->absent++;
        return KILN_OK;
    }
    struct kiln_uv_verdict verdict = {.valid = true, .uv_area = known_area};
    int status = sound ? KILN_OK
                       : kiln_uv_check(&verdict, positions(p, mesh), lightmap_uv(p, mesh), triangles(p, mesh),
                                       mesh->triangle_count, error);
    if (status != KILN_OK)
        return status;
    if (!verdict.valid)
        return note_wanted(&p->refused)
                   ? kiln_builder_note(p->builder, 1, error,
                                       "mesh \"%s\": its second UV set %s; kiln unwraps the mesh instead",
                                       string(p, mesh->name), verdict.reason)
                   : KILN_OK;
    if (verdict.warning[0] != '\0' && note_wanted(&p->unclean))
        status = kiln_builder_note(p->builder, 1, error,
                                   "mesh \"%s\": its second UV set %s; its charts are used as they are",
                                   string(p, mesh->name), verdict.warning);
    plan->unwrap = false;
    mesh->uv_area = verdict.uv_area;
    struct kiln_vec2 *uv = lightmap_uv(p, mesh);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        /* Vertices that no triangle uses may have any coordinates. */
        uv[i].x = isfinite(uv[i].x) ? fminf(fmaxf(uv[i].x, 0.0f), 1.0f) : 0.0f;
        uv[i].y = isfinite(uv[i].y) ? fminf(fmaxf(uv[i].y, 0.0f), 1.0f) : 0.0f;
    }
    return status;
}

static void measure_objects(struct planner *p)
{
    for (size_t i = 0; i < object_count(p); i++) {
        const struct kiln_object *object = &objects(p)[i];
        const struct kiln_mesh *mesh = &meshes(p)[object->mesh];
        struct mesh_plan *plan = &p->plans[object->mesh];
        p->measures[i] = measure_shape(&plan->shape, positions(p, mesh), plan->unwrap ? NULL : lightmap_uv(p, mesh),
                                       triangles(p, mesh), mesh->triangle_count, object->transform);
    }
}

/* ---- densities ---- */

struct box {
    double low[3], high[3];
};

static void enclose(const struct planner *p, size_t index, struct box *box)
{
    const struct kiln_object *object = &objects(p)[index];
    const struct kiln_mesh *mesh = &meshes(p)[object->mesh];
    double linear[9];
    linear_part(object->transform, linear);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        const struct kiln_dvec3 v = apply(linear, dvec3_of(positions(p, mesh)[i]));
        const double at[3] = {v.x + object->transform[3], v.y + object->transform[7], v.z + object->transform[11]};
        for (int k = 0; k < 3; k++) {
            box->low[k] = fmin(box->low[k], at[k]);
            box->high[k] = fmax(box->high[k], at[k]);
        }
    }
}

/* Finds the ground: an object that lies around all others. It is the largest one, flat, at least GROUND_LEAST long, and
 * GROUND_SPREAD times as wide and as long as all others together. The floor of a room is no ground. */
static void find_ground(struct planner *p)
{
    struct box own = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}}, rest = own;
    size_t largest = SIZE_MAX;
    for (size_t i = 0; i < object_count(p); i++)
        if (p->measures[i].area > 0.0 && (largest == SIZE_MAX || p->measures[i].area > p->measures[largest].area))
            largest = i;
    p->ground = SIZE_MAX;
    if (largest == SIZE_MAX)
        return;
    enclose(p, largest, &own);
    for (size_t i = 0; i < object_count(p); i++)
        if (i != largest)
            enclose(p, i, &rest);
    int flat = 0, wide = 0;
    double longest = 0.0;
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, own.high[k] - own.low[k]);
    for (int k = 0; k < 3; k++) {
        const double side = own.high[k] - own.low[k], others = rest.high[k] - rest.low[k];
        flat += side <= GROUND_FLAT * longest;
        wide += side > GROUND_FLAT * longest && others >= 0.0 && side >= GROUND_SPREAD * others;
    }
    if (flat == 1 && wide == 2 && longest >= GROUND_LEAST)
        p->ground = largest;
}

/* The user's factor on an object's density; 1 where none is given. */
static double scale_of(const struct planner *p, size_t index)
{
    const double scale = settings_of(p, index)->density_scale;
    return scale > 0.0 ? scale : 1.0;
}

/* The factor that an object's role puts on its density where the user gives none. */
static double role_factor(const struct planner *p, size_t index)
{
    const struct kiln_object_settings *settings = settings_of(p, index);
    return settings->role == KILN_ROLE_CASTER_ONLY && settings->density_scale == 0.0 ? CASTER_FACTOR : 1.0;
}

/* The lightmap side that the user gives for an object; 0: the size follows the density. A factor makes no side longer
 * than the largest. */
static uint32_t own_size(const struct planner *p, size_t index)
{
    const struct kiln_object_settings *settings = settings_of(p, index);
    const uint32_t size = p->params.lightmap_size, most = size > p->params.lightmap_max ? size : p->params.lightmap_max;
    if (settings->lightmap_size > 0)
        return settings->lightmap_size;
    return size == 0 ? 0 : (uint32_t)fmin(fmax(1.0, round(size * scale_of(p, index) * role_factor(p, index))), most);
}

/* Returns the mean density of an object in a lightmap of one texel per metre: the square root of texels per m2 of its
 * surface. */
static double mean_density(const struct planner *p, size_t index)
{
    const struct measure *m = &p->measures[index];
    const struct kiln_mesh *mesh = &meshes(p)[objects(p)[index].mesh];
    const double mean = sqrt(m->along_u * m->along_v * mesh->uv_area / m->area);
    return !p->plans[objects(p)[index].mesh].unwrap && isfinite(mean) && mean > 0.0 ? mean : 1.0;
}

/* Makes an object's demand for texels. An object with a given size demands none. One with a density-scale demands as
 * many as without it, and is scaled afterwards. */
static struct kiln_density_demand demand_of(const struct planner *p, size_t index)
{
    const struct measure *m = &p->measures[index];
    const struct mesh_plan *plan = &p->plans[objects(p)[index].mesh];
    struct kiln_density_demand demand = {
        .factor = role_factor(p, index), .area = m->area, .mean = mean_density(p, index), .ground = index == p->ground};
    if (settings_of(p, index)->lightmap_size > 0)
        return demand;
    demand.texels = plan->unwrap ? m->area / plan->use : m->along_u * m->along_v;
    demand.longer = plan->unwrap ? sqrt(demand.texels) : fmax(m->along_u, m->along_v);
    return demand;
}

/* Whether automatic density gives the object no more because of the limit relative to the largest object. */
static bool is_bounded(const struct planner *p, size_t index)
{
    const size_t largest = p->density.largest;
    return largest != SIZE_MAX && index != largest && scale_of(p, index) == 1.0 &&
           p->density.of[index] * mean_density(p, index) >=
               0.999 * KILN_DENSITY_SPREAD * p->density.of[largest] * mean_density(p, largest);
}

/* Why an object's density differs from the common one. */
static uint32_t reason_of(const struct planner *p, size_t index, const struct kiln_density_demand *demand)
{
    const double density = p->density.of[index], wanted = p->density.texels_per_metre * demand->factor;
    if (settings_of(p, index)->lightmap_size > 0)
        return KILN_DENSITY_SIZED;
    if (settings_of(p, index)->density_scale > 0.0)
        return KILN_DENSITY_SCALED;
    if (p->params.lightmap_size > 0)
        return settings_of(p, index)->role == KILN_ROLE_CASTER_ONLY ? KILN_DENSITY_CASTER : KILN_DENSITY_COMMON;
    if (density > wanted * (1.0 + 1e-6))
        return KILN_DENSITY_LEAST;
    if (density < wanted * (1.0 - 1e-6) && is_bounded(p, index))
        return KILN_DENSITY_BOUNDED;
    if (density < wanted * (1.0 - 1e-6))
        return KILN_DENSITY_FRACTION;
    return settings_of(p, index)->role == KILN_ROLE_CASTER_ONLY ? KILN_DENSITY_CASTER : KILN_DENSITY_COMMON;
}

/* Gives all objects the user's density, times their own factors. */
static int name_densities(struct planner *p, struct kiln_error *error)
{
    p->density = (struct kiln_density){
        .texels_per_metre = p->params.texels_per_metre, .most_texels = INFINITY, .largest = SIZE_MAX};
    const int status = kiln_allocate(&p->density.of, object_count(p), sizeof *p->density.of, "densities", error);
    for (size_t i = 0; i < object_count(p) && status == KILN_OK; i++)
        p->density.of[i] = p->params.texels_per_metre * role_factor(p, i);
    return status;
}

static int deal_densities(struct planner *p, struct kiln_density_demand *demands, struct kiln_error *error)
{
    for (size_t i = 0; i < object_count(p); i++)
        demands[i] = demand_of(p, i);
    kiln_free(&p->density.of);
    return p->params.texels_per_metre > 0.0
               ? name_densities(p, error)
               : kiln_density_choose(&p->density, demands, object_count(p), p->params.texels, error);
}

/* ---- limits of the number of texels ---- */

static double side_at(const struct planner *p, double texels)
{
    return isfinite(texels) ? fmin(fmax(ceil(texels), 1.0), p->params.lightmap_max) : 1.0;
}

/* Estimates the texels of an object's lightmap at a density, as far as its mesh is known so far. `size`: side to use
 * instead. */
static double texels_at(const struct planner *p, size_t index, double density, double size)
{
    const struct measure *m = &p->measures[index];
    const struct mesh_plan *plan = &p->plans[objects(p)[index].mesh];
    if (size > 0.0)
        return size * size;
    if (!plan->unwrap)
        return side_at(p, density * m->along_u) * side_at(p, density * m->along_v);
    const double side = side_at(p, density * sqrt(m->area / plan->use));
    return side * side;
}

/* Sum of lightmap texels over objects, the largest number of one object, and that object. */
struct texel_sum {
    double all, most;
    size_t largest;
};

static void add_texels(struct texel_sum *sum, size_t index, double texels)
{
    sum->all += texels;
    if (texels > sum->most) {
        sum->most = texels;
        sum->largest = index;
    }
}

/* An object's size, as a sentence names it. */
static const char *name_size(const struct planner *p, size_t index, char text[64])
{
    if (own_size(p, index) > 0)
        (void)snprintf(text, 64, "a side of %u texels", own_size(p, index));
    else
        (void)snprintf(text, 64, "%.3g texels a metre", p->densities[index]);
    return text;
}

/* Refuses too many texels of all lightmaps, or of those that the file itself scales or sizes. `plain`: of the latter
 * without the file's settings. */
static int judge_texels(const struct planner *p, const struct texel_sum *all, const struct texel_sum *own, double plain,
                        struct kiln_error *error)
{
    const bool named = p->params.texels_per_metre > 0.0 || p->params.lightmap_size > 0;
    const double most = fmax(OWN_TEXELS, named ? OWN_TIMES * plain : 0.0);
    char size[64];
    if (own->all > most)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.512s: settings in the file (its nodes' extras) ask for lightmaps of %.0f million texels in "
                         "all, %.0f million of them for object \"%.100s\" with %s; such settings may ask for %.0f "
                         "million: set the sizes yourself with --objects, such as '{\"*\": {lightmap-size: 512}}'",
                         p->params.scene, own->all * 1e-6, own->most * 1e-6, string(p, objects(p)[own->largest].name),
                         name_size(p, own->largest, size), most * 1e-6);
    if (p->params.texels_max > 0.0 && all->all > p->params.texels_max)
        return kiln_fail(error, KILN_USAGE,
                         "%.512s: the lightmaps would have %.0f million texels in all, %.0f million of them for object "
                         "\"%.100s\" with %s; the memory of this host allows %.0f million at most: give fewer "
                         "--texels-per-metre, or a smaller --lightmap-max or --lightmap-size",
                         p->params.scene, all->all * 1e-6, all->most * 1e-6, string(p, objects(p)[all->largest].name),
                         name_size(p, all->largest, size), p->params.texels_max * 1e-6);
    return KILN_OK;
}

/* Checks the number of texels before any work per texel, with the sizes that densities will give. `sized`: with the
 * sizes that objects already have. */
static int check_texels(const struct planner *p, bool sized, struct kiln_error *error)
{
    struct texel_sum all = {.all = 0.0}, own = {.all = 0.0};
    double plain = 0.0;
    for (size_t i = 0; i < object_count(p); i++) {
        const struct kiln_object *object = &objects(p)[i];
        const double texels = sized ? (double)object->lightmap_width * (double)object->lightmap_height
                                    : texels_at(p, i, p->densities[i], own_size(p, i));
        add_texels(&all, i, texels);
        if (!settings_of(p, i)->size_of_file)
            continue;
        add_texels(&own, i, texels);
        plain += texels_at(p, i, p->density.of[i], p->params.lightmap_size);
    }
    return judge_texels(p, &all, &own, plain, error);
}

/* Chooses the common density and each object's, for automatic density. Called again after unwrapping, when it is known
 * how well the meshes pack. */
static int choose_densities(struct planner *p, struct kiln_error *error)
{
    struct kiln_density_demand *demands = NULL;
    int status;
    KILN_TRY(kiln_allocate(&demands, object_count(p), sizeof *demands, "densities", error));
    if (p->densities == NULL)
        KILN_TRY(
            kiln_arena_allocate(&p->arena, &p->densities, object_count(p), sizeof *p->densities, "densities", error));
    KILN_TRY(deal_densities(p, demands, error));
end:
    p->texels_per_metre = p->density.texels_per_metre;
    for (size_t i = 0; i < object_count(p) && status == KILN_OK; i++) {
        p->densities[i] = p->density.of[i] * scale_of(p, i);
        objects(p)[i].density_reason = reason_of(p, i, &demands[i]);
    }
    kiln_free(&demands);
    return status == KILN_OK ? check_texels(p, false, error) : status;
}

/* Number of texels that an object should have. */
static double wanted_texels(const struct planner *p, size_t index)
{
    const double size = own_size(p, index), density = p->densities[index];
    return size > 0.0 ? size * size : p->measures[index].area * density * density;
}

/* Finds each mesh's object with the most texels (of several, the largest). The mesh is unwrapped for that object. */
static void find_references(struct planner *p)
{
    for (size_t i = 0; i < mesh_count(p); i++)
        p->plans[i].reference = SIZE_MAX;
    for (size_t i = 0; i < object_count(p); i++) {
        struct mesh_plan *plan = &p->plans[objects(p)[i].mesh];
        const double area = p->measures[i].area, texels = wanted_texels(p, i);
        if (!isfinite(area) || !(area > 0.0))
            continue;
        const double most = plan->reference == SIZE_MAX ? -1.0 : wanted_texels(p, plan->reference);
        if (texels > most || (texels == most && area > p->measures[plan->reference].area))
            plan->reference = i;
    }
}

static int note_packing(struct planner *p, size_t index, struct kiln_error *error)
{
    const struct kiln_mesh *mesh = &meshes(p)[index];
    const struct mesh_plan *plan = &p->plans[index];
    const struct kiln_unwrapped *u = plan->unwrapped;
    int status = KILN_OK;
    if (u->cells > 1 && note_wanted(&p->shared))
        status = kiln_builder_note(
            p->builder, 1, error,
            "mesh \"%s\": its %zu charts do not fit a lightmap of %u x %u with a texel each, so charts share texels; "
            "allow larger lightmaps or split the mesh",
            string(p, mesh->name), u->chart_count, u->width, u->height);
    else if (!plan->sized && u->texels_per_metre < plan->density * (1.0 - 1e-9) && note_wanted(&p->capped))
        status = kiln_builder_note(
            p->builder, 1, error,
            "mesh \"%s\": its lightmap would be larger than %u texels a side; it has %.3g texels a metre "
            "instead of %.3g",
            string(p, mesh->name), p->params.lightmap_max, u->texels_per_metre, plan->density);
    return status;
}

/* Area of the new layout, as a fraction of the unit square. */
static double layout_area(const struct kiln_unwrapped *u, uint64_t triangle_count)
{
    double area = 0.0;
    for (size_t i = 0; i < triangle_count; i++) {
        const struct kiln_vec2 a = u->uv[u->triangles[3 * i]], b = u->uv[u->triangles[3 * i + 1]],
                               c = u->uv[u->triangles[3 * i + 2]];
        area += 0.5 * fabs(((double)b.x - (double)a.x) * ((double)c.y - (double)a.y) -
                           ((double)b.y - (double)a.y) * ((double)c.x - (double)a.x));
    }
    return area;
}

static int unwrap_mesh(struct planner *p, size_t index, struct kiln_error *error)
{
    struct kiln_mesh *mesh = &meshes(p)[index];
    struct mesh_plan *plan = &p->plans[index];
    struct kiln_unwrap_params params = {.linear = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0},
                                        .texels_per_metre = p->texels_per_metre,
                                        .padding = p->params.padding,
                                        .size = p->params.lightmap_size,
                                        .max = p->params.lightmap_max};
    if (plan->reference != SIZE_MAX) {
        linear_part(objects(p)[plan->reference].transform, params.linear);
        params.texels_per_metre = p->densities[plan->reference];
        params.size = own_size(p, plan->reference);
    }
    kiln_unwrapped_destroy(&plan->unwrapped);
    const int status = plan->repack
                           ? kiln_repack(&plan->unwrapped, positions(p, mesh), lightmap_uv(p, mesh), mesh->vertex_count,
                                         triangles(p, mesh), mesh->triangle_count, plan->metres, &params, error)
                           : kiln_unwrap(&plan->unwrapped, positions(p, mesh), mesh->vertex_count, triangles(p, mesh),
                                         mesh->triangle_count, &params, error);
    if (status != KILN_OK)
        return status;
    plan->padding_count = 0;
    mesh->flags |= plan->repack ? KILN_MESH_UNWRAPPED | KILN_MESH_REPACKED : KILN_MESH_UNWRAPPED;
    mesh->uv_area = layout_area(plan->unwrapped, mesh->triangle_count);
    plan->sized = params.size > 0;
    plan->density = plan->sized ? plan->unwrapped->texels_per_metre : params.texels_per_metre;
    if (mesh->uv_area > 0.0)
        plan->use = mesh->uv_area;
    return KILN_OK;
}

/* Measures an unwrapped mesh in its new layout, for each object that shows it: into `measures`. */
static int measure_unwrapped(struct planner *p, size_t index, const size_t *members, size_t member_count,
                             struct kiln_error *error)
{
    const struct kiln_mesh *mesh = &meshes(p)[index];
    struct mesh_plan *plan = &p->plans[index];
    const struct kiln_unwrapped *u = plan->unwrapped;
    struct kiln_vec3 *points = NULL;
    const int status = kiln_allocate(&points, u->vertex_count, sizeof *points, "unwrapped vertices", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < u->vertex_count; i++)
        points[i] = positions(p, mesh)[u->source[i]];
    plan->shape.known = false;
    for (size_t i = 0; i < member_count; i++)
        p->measures[members[i]] = measure_shape(&plan->shape, points, u->uv, u->triangles, mesh->triangle_count,
                                                objects(p)[members[i]].transform);
    kiln_free(&points);
    if (plan->reference != SIZE_MAX)
        plan->measure = p->measures[plan->reference];
    return KILN_OK;
}

/* Sorts the objects by mesh: first[m] .. first[m + 1] in `members`. */
static void group_objects(const struct planner *p, size_t *first, size_t *members)
{
    for (size_t i = 0; i < object_count(p); i++)
        first[objects(p)[i].mesh + 1]++;
    for (size_t m = 0; m < mesh_count(p); m++)
        first[m + 1] += first[m];
    for (size_t i = object_count(p); i-- > 0;)
        members[--first[objects(p)[i].mesh + 1]] = i;
    /* Filling has moved each entry to the start of its mesh's range: shift the starts back into place. */
    for (size_t m = 0; m < mesh_count(p); m++)
        first[m] = first[m + 1];
    first[mesh_count(p)] = object_count(p);
}

/* Does as group_objects, into arrays that the caller frees with kiln_free. */
static int list_objects(const struct planner *p, size_t **first, size_t **members, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate(first, mesh_count(p) + 1, sizeof **first, "layouts", error));
    KILN_TRY(kiln_allocate(members, object_count(p), sizeof **members, "layouts", error));
    group_objects(p, *first, *members);
end:
    return status;
}

/* Whether the mesh needs a layout: it has none, or one for a clearly different density. */
static bool is_stale(const struct planner *p, size_t index)
{
    const struct mesh_plan *plan = &p->plans[index];
    if (!plan->unwrap || plan->unwrapped == NULL)
        return plan->unwrap;
    return plan->reference != SIZE_MAX && !plan->sized &&
           fabs(p->densities[plan->reference] / plan->density - 1.0) > 0.03;
}

static int unwrap_meshes(struct planner *p, struct kiln_error *error)
{
    size_t *first = NULL, *members = NULL;
    int status = list_objects(p, &first, &members, error);
    for (size_t i = 0; i < mesh_count(p) && status == KILN_OK; i++) {
        if (!is_stale(p, i))
            continue;
        status = unwrap_mesh(p, i, error);
        if (status == KILN_OK)
            status = measure_unwrapped(p, i, members + first[i], first[i + 1] - first[i], error);
    }
    kiln_free(&members);
    kiln_free(&first);
    return status;
}

/* Texels along one side, at least `least`, at most the largest allowed; *capped is set if that limit applies. */
static uint32_t side_of(const struct planner *p, double texels, uint32_t least, bool *capped)
{
    const double side = isfinite(texels) ? fmax(ceil(texels - 1e-3), least) : least;
    *capped = *capped || side > p->params.lightmap_max;
    return (uint32_t)fmin(fmax(side, 1.0), p->params.lightmap_max);
}

/* The lightmap size that follows from the density. *capped is set if the largest side allowed is too small for it. */
static void size_by_density(const struct planner *p, size_t index, uint32_t *width, uint32_t *height, bool *capped)
{
    const struct mesh_plan *plan = &p->plans[objects(p)[index].mesh];
    const struct measure m = p->measures[index];
    const double density = p->densities[index];
    if (!plan->unwrap || plan->reference == SIZE_MAX) {
        const double w = density * m.along_u, h = density * m.along_v;
        *width = side_of(p, is_bounded(p, index) ? round(w) : w, 1, capped);
        *height = side_of(p, is_bounded(p, index) ? round(h) : h, 1, capped);
        return;
    }
    const struct kiln_unwrapped *u = plan->unwrapped;
    /* sizes with at least one texel of padding left */
    const uint32_t least_width = (u->width + p->params.padding - 1) / p->params.padding;
    const uint32_t least_height = (u->height + p->params.padding - 1) / p->params.padding;
    *width =
        side_of(p, u->width * (m.along_u / plan->measure.along_u) * (density / plan->density), least_width, capped);
    *height =
        side_of(p, u->height * (m.along_v / plan->measure.along_v) * (density / plan->density), least_height, capped);
}

/* The size of an object's lightmap; *capped as for size_by_density. */
static void object_size(const struct planner *p, size_t index, uint32_t *width, uint32_t *height, bool *capped)
{
    *width = *height = own_size(p, index);
    if (*width == 0)
        size_by_density(p, index, width, height, capped);
}

static int size_object(struct planner *p, size_t index, struct kiln_error *error)
{
    struct kiln_object *object = &objects(p)[index];
    bool capped = false;
    object_size(p, index, &object->lightmap_width, &object->lightmap_height, &capped);
    if (capped)
        object->density_reason = KILN_DENSITY_MAX;
    if (capped && note_wanted(&p->capped))
        return kiln_builder_note(
            p->builder, 1, error,
            "object \"%s\": its lightmap would be larger than %u texels a side and is capped there; it has fewer "
            "than %.3g texels a metre",
            string(p, object->name), p->params.lightmap_max, p->densities[index]);
    return KILN_OK;
}

/* ---- padding ---- */

/* Most lightmap sizes at which a mesh's layout is measured. Objects may stretch a mesh in many ways, and measuring all
 * of them would take many times the import. */
enum { PADDINGS_MAX = 12 };

/* Finds the measurement at the lightmap size nearest to width x height. *difference: that of the logarithms of sides; 0
 * for the same size. */
static const struct sized_padding *nearest_padding(const struct mesh_plan *plan, double width, double height,
                                                   double *difference)
{
    const struct sized_padding *best = NULL;
    *difference = INFINITY;
    for (size_t i = 0; i < plan->padding_count; i++) {
        const struct sized_padding *p = &plan->paddings[i];
        const double own = fabs(log(width / p->width)) + fabs(log(height / p->height));
        if (own < *difference) {
            *difference = own;
            best = p;
        }
    }
    return best;
}

/* Measures how far apart an object's charts lie in a lightmap of width x height. Where the mesh has more than
 * PADDINGS_MAX sizes, uses the measurement at the nearest size. Factors that would make a side longer than allowed are
 * left out. */
static int measure_padding(struct planner *p, size_t index, double width, double height, struct kiln_padding *padding,
                           struct kiln_error *error)
{
    const struct kiln_mesh *mesh = &meshes(p)[objects(p)[index].mesh];
    struct mesh_plan *plan = &p->plans[objects(p)[index].mesh];
    double difference = 0.0;
    const struct sized_padding *likest = nearest_padding(plan, width, height, &difference);
    int status = KILN_OK;
    if (difference > 0.0 && plan->padding_count < PADDINGS_MAX) {
        status = kiln_grow(&plan->paddings, &plan->padding_capacity, plan->padding_count + 1, sizeof *plan->paddings,
                           "padding of layouts", error);
        if (status != KILN_OK)
            return status;
        struct sized_padding *made = &plan->paddings[plan->padding_count++];
        *made = (struct sized_padding){.width = width, .height = height};
        status = kiln_padding_measure(&made->padding, positions(p, mesh), lightmap_uv(p, mesh), mesh->vertex_count,
                                      triangles(p, mesh), mesh->triangle_count, width, height, error);
        likest = made;
    }
    *padding = likest->padding;
    const double most = p->params.lightmap_max / fmax(width, height);
    for (int i = 0; i < KILN_PADDING_STEPS; i++)
        if (exp2((double)(i + 1) / KILN_PADDING_OCTAVE) > most)
            padding->by_factor[i] = 0.0;
    return status;
}

/* Marks the mesh's charts for repacking, for the object with the most texels. */
static void mark_for_repack(struct planner *p, size_t index)
{
    struct mesh_plan *plan = &p->plans[index];
    const struct measure *m = &p->measures[plan->reference];
    plan->unwrap = plan->repack = true;
    plan->metres[0] = m->along_u;
    plan->metres[1] = m->along_v;
}

/* Marks for repacking the meshes whose charts lie less than two texels apart in the lightmap of the object with the
 * most texels. */
static int choose_repacks(struct planner *p, struct kiln_error *error)
{
    int status = choose_densities(p, error);
    find_references(p);
    for (size_t i = 0; i < mesh_count(p) && status == KILN_OK; i++) {
        struct mesh_plan *plan = &p->plans[i];
        struct kiln_padding padding;
        if (plan->unwrap || plan->reference == SIZE_MAX)
            continue;
        const struct measure *m = &p->measures[plan->reference];
        const double size = own_size(p, plan->reference), density = p->densities[plan->reference],
                     most = p->params.lightmap_max;
        const double width = size > 0.0 ? size : fmin(density * m->along_u, most),
                     height = size > 0.0 ? size : fmin(density * m->along_v, most);
        if (!(width > 0.0 && height > 0.0))
            continue;
        status = measure_padding(p, plan->reference, width, height, &padding, error);
        if (status != KILN_OK || !(padding.close > 0.0))
            continue;
        mark_for_repack(p, i);
        p->repacked++;
    }
    return status;
}

/* An object whose charts would lie far enough apart if it had more texels. */
struct raise {
    size_t object;
    double factor, added; /* factor on the lightmap's sides; texels that this adds */
    double worth;         /* benefit per added texel: metres of border that become far enough from other charts */
};

static int compare_raises(const void *a, const void *b)
{
    const struct raise *p = a, *q = b;
    if (p->worth != q->worth)
        return p->worth > q->worth ? -1 : 1;
    return (p->object > q->object) - (p->object < q->object);
}

/* Whether automatic density may raise the object's: it has its layout from the file, and the user gives no density for
 * it. */
static bool may_raise(const struct planner *p, size_t index)
{
    const struct kiln_object_settings *settings = settings_of(p, index);
    const struct measure *m = &p->measures[index];
    return !p->plans[objects(p)[index].mesh].unwrap && own_size(p, index) == 0 && settings->density_scale == 0.0 &&
           settings->role != KILN_ROLE_CASTER_ONLY && isfinite(m->along_u) && isfinite(m->along_v) &&
           m->along_u > 0.0 && m->along_v > 0.0;
}

/* Whether the density is not too much finer than that of the largest object. */
static bool is_even(const struct planner *p, size_t object, double density)
{
    const size_t largest = p->density.largest;
    return largest == SIZE_MAX || object == largest ||
           density * mean_density(p, object) <=
               KILN_DENSITY_SPREAD * p->densities[largest] * mean_density(p, largest) * (1.0 + 1e-9);
}

/* Raises the densities of the largest object and then of those with the most worth per texel, as long as the scene
 * stays below PADDED times its texels. An object may then have more than its allowed fraction of all texels: light that
 * bleeds between charts is worse. */
static void raise_best(struct planner *p, struct raise *raises, size_t count, double texels)
{
    for (size_t i = 0; i < count; i++)
        if (raises[i].object == p->density.largest)
            raises[i].worth = INFINITY;
    qsort(raises, count, sizeof *raises, compare_raises);
    for (size_t i = 0; i < count; i++) {
        const struct raise *raise = &raises[i];
        if (texels + raise->added > PADDED * p->params.texels ||
            !is_even(p, raise->object, p->densities[raise->object] * raise->factor))
            continue;
        texels += raise->added;
        p->densities[raise->object] *= raise->factor;
        objects(p)[raise->object].density_reason = KILN_DENSITY_PADDING;
    }
}

static struct raise raise_of(size_t object, double factor, double density, double texels,
                             const struct kiln_padding *padding)
{
    const double added = texels * (factor * factor - 1.0);
    return (struct raise){object, factor, added, padding->close / (density * added)};
}

static int raise_densities(struct planner *p, struct kiln_error *error)
{
    struct raise *raises = NULL;
    size_t count = 0;
    double texels = 0.0;
    int status = kiln_allocate(&raises, object_count(p), sizeof *raises, "densities", error);
    for (size_t i = 0; i < object_count(p) && status == KILN_OK; i++) {
        const double own = wanted_texels(p, i), density = p->densities[i];
        struct kiln_padding padding;
        texels += isfinite(own) ? own : 0.0;
        if (!may_raise(p, i))
            continue;
        const double width = density * p->measures[i].along_u, height = density * p->measures[i].along_v;
        texels += width * height - own; /* the texels of the whole lightmap */
        status = measure_padding(p, i, width, height, &padding, error);
        const double factor = status == KILN_OK ? kiln_padding_factor(&padding, CLOSE_FRACTION) : 1.0;
        if (factor > 1.0 && factor <= RAISE_MAX)
            raises[count++] = raise_of(i, factor, density, width * height, &padding);
    }
    if (status == KILN_OK)
        raise_best(p, raises, count, texels);
    kiln_free(&raises);
    return status;
}

/* ---- shared texels ---- */

/* Opens a mesh's layout as it stands in the builder. */
static int open_sharing(const struct planner *p, size_t index, struct kiln_sharing *sharing, struct kiln_error *error)
{
    const struct kiln_mesh *mesh = &meshes(p)[index];
    return kiln_sharing_open(sharing, positions(p, mesh), lightmap_uv(p, mesh), mesh->vertex_count, triangles(p, mesh),
                             mesh->triangle_count, error);
}

/* Counts the shared texels in the lightmaps of the mesh's objects; stops at the first lightmap with any. */
static int count_shared(struct planner *p, size_t index, struct kiln_sharing *sharing, const size_t *members,
                        size_t count, uint64_t *texels, struct kiln_error *error)
{
    uint32_t size[2] = {0, 0}, before[2] = {0, 0};
    int status = open_sharing(p, index, sharing, error);
    *texels = 0;
    for (size_t i = 0; i < count && status == KILN_OK && *texels == 0; i++) {
        bool capped = false;
        object_size(p, members[i], &size[0], &size[1], &capped);
        if (size[0] == before[0] && size[1] == before[1])
            continue;
        memcpy(before, size, sizeof size);
        status = kiln_sharing_count(sharing, size[0], size[1], 0, texels, error);
    }
    if (*texels > p->most_shared) {
        p->most_shared = *texels;
        p->most_shared_mesh = index;
        memcpy(p->most_shared_size, size, sizeof size);
    }
    return status;
}

/* Resets an object's density to that before it was raised for its layout from the file. */
static void reset_density(struct planner *p, size_t index)
{
    const struct kiln_density_demand demand = demand_of(p, index);
    p->densities[index] = p->density.of[index] * scale_of(p, index);
    objects(p)[index].density_reason = reason_of(p, index, &demand);
}

/* Marks for repacking the meshes whose charts share texels in the lightmap of an object. first[m] .. first[m + 1]: the
 * objects of mesh m in `members`. */
static int choose_shared(struct planner *p, const size_t *first, const size_t *members, struct kiln_error *error)
{
    struct kiln_sharing sharing = {0};
    int status = KILN_OK;
    for (size_t m = 0; m < mesh_count(p) && status == KILN_OK; m++) {
        uint64_t texels = 0;
        if (p->plans[m].unwrap || p->plans[m].reference == SIZE_MAX)
            continue;
        status = count_shared(p, m, &sharing, members + first[m], first[m + 1] - first[m], &texels, error);
        if (status != KILN_OK || texels == 0)
            continue;
        mark_for_repack(p, m);
        p->plans[m].parted = true;
        p->parted++;
        for (size_t i = first[m]; i < first[m + 1]; i++)
            reset_density(p, members[i]);
    }
    kiln_sharing_close(&sharing);
    return status;
}

/* Repacks the charts of meshes with shared texels, at the present densities of the objects. */
static int part_shared(struct planner *p, struct kiln_error *error)
{
    size_t *first = NULL, *members = NULL;
    int status;
    KILN_TRY(list_objects(p, &first, &members, error));
    KILN_TRY(choose_shared(p, first, members, error));
    if (p->parted > 0)
        KILN_TRY(unwrap_meshes(p, error));
    for (size_t m = 0; m < mesh_count(p); m++)
        if (p->plans[m].parted)
            KILN_TRY(note_packing(p, m, error));
end:
    kiln_free(&members);
    kiln_free(&first);
    return status;
}

static bool has_two_sides(const struct planner *p, const struct kiln_mesh *mesh)
{
    const struct kiln_material *materials =
        KILN_BUILDER_DATA(p->builder, const struct kiln_material, KILN_SECTION_MATERIALS);
    const uint32_t *of = KILN_BUILDER_DATA(p->builder, const uint32_t, KILN_SECTION_TRIANGLE_MATERIALS);
    for (size_t i = 0; i < mesh->triangle_count; i++)
        if (materials[of[mesh->triangle_first + i]].double_sided)
            return true;
    return false;
}

/* Finds out whether charts that share no texels in the front's lightmap do so in one with half as many texels a side:
 * more than SHARED_OF_BACKS of all. */
static int backs_share(struct kiln_sharing *sharing, uint32_t width, uint32_t height, bool *share,
                       struct kiln_error *error)
{
    const double least = SHARED_OF_BACKS * 0.25 * width * height;
    uint64_t front = 0, back = 0;
    int status = kiln_sharing_count(sharing, width, height, 1, &back, error);
    if (status == KILN_OK && (double)back > least)
        status = kiln_sharing_count(sharing, width, height, 0, &front, error);
    *share = (double)back > (double)front + least;
    return status;
}

static int keep_backs_of_mesh(struct planner *p, size_t index, struct kiln_sharing *sharing, const size_t *members,
                              size_t count, struct kiln_error *error)
{
    uint32_t before[2] = {0, 0};
    bool share = false;
    int status = open_sharing(p, index, sharing, error);
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        struct kiln_object *object = &objects(p)[members[i]];
        const uint32_t size[2] = {object->lightmap_width, object->lightmap_height};
        if (size[0] != before[0] || size[1] != before[1])
            status = backs_share(sharing, size[0], size[1], &share, error);
        memcpy(before, size, sizeof size);
        object->flags |= share ? KILN_OBJECT_FINE_BACKS : 0u;
    }
    return status;
}

/* The lightmap of an object's back has half as many texels a side as that of its front, unless charts would share
 * texels there. */
static int keep_backs_apart(struct planner *p, struct kiln_error *error)
{
    struct kiln_sharing sharing = {0};
    size_t *first = NULL, *members = NULL;
    int status = list_objects(p, &first, &members, error);
    for (size_t m = 0; m < mesh_count(p) && status == KILN_OK; m++)
        if (first[m + 1] > first[m] && has_two_sides(p, &meshes(p)[m]))
            status = keep_backs_of_mesh(p, m, &sharing, members + first[m], first[m + 1] - first[m], error);
    kiln_sharing_close(&sharing);
    kiln_free(&members);
    kiln_free(&first);
    return status;
}

/* ---- notes ---- */

/* Sums over the padding of all published lightmaps. */
struct padding_sum {
    struct kiln_padding all;    /* at the sizes that the lightmaps have */
    struct kiln_padding common; /* at the sizes for the header's density, in texels of that density */
    /* counts of lightmaps: with several charts; with more than CLOSE_FRACTION of border too close; with a raised
     * density */
    size_t lightmaps, close, raised;
    double raise; /* the largest factor by which a density was raised */
    size_t worst; /* the object with the largest fraction of close border */
    double worst_fraction;
};

/* Whether the object's lightmap would have another size with the header's density. */
static bool differs_from_common(const struct planner *p, size_t index)
{
    return !p->plans[objects(p)[index].mesh].unwrap && own_size(p, index) == 0 &&
           fabs(p->densities[index] / p->texels_per_metre - 1.0) > 1e-3;
}

static int add_common(struct planner *p, size_t index, const struct kiln_padding *own, struct padding_sum *sum,
                      struct kiln_error *error)
{
    const struct measure *m = &p->measures[index];
    const double most = p->params.lightmap_max, width = fmin(p->texels_per_metre * m->along_u, most),
                 height = fmin(p->texels_per_metre * m->along_v, most);
    struct kiln_padding padding = *own;
    int status = KILN_OK;
    if (differs_from_common(p, index) && width > 0.0 && height > 0.0)
        status = measure_padding(p, index, width, height, &padding, error);
    kiln_padding_add(&sum->common, &padding);
    return status;
}

static int add_object(struct planner *p, size_t index, struct padding_sum *sum, struct kiln_error *error)
{
    const struct kiln_object *object = &objects(p)[index];
    struct kiln_padding padding;
    const int status = measure_padding(p, index, object->lightmap_width, object->lightmap_height, &padding, error);
    if (status != KILN_OK)
        return status;
    const double close_fraction = padding.border > 0.0 ? padding.close / padding.border : 0.0;
    kiln_padding_add(&sum->all, &padding);
    sum->lightmaps += padding.charts > 1;
    sum->close += close_fraction > CLOSE_FRACTION;
    if (close_fraction > sum->worst_fraction) {
        sum->worst = index;
        sum->worst_fraction = close_fraction;
    }
    if (object->density_reason == KILN_DENSITY_PADDING) {
        sum->raised++;
        sum->raise = fmax(sum->raise, p->densities[index] / p->density.of[index]);
    }
    return add_common(p, index, &padding, sum, error);
}

static int sum_padding(struct planner *p, struct padding_sum *sum, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < object_count(p) && status == KILN_OK; i++)
        if (settings_of(p, i)->role != KILN_ROLE_CASTER_ONLY && meshes(p)[objects(p)[i].mesh].triangle_count > 0)
            status = add_object(p, i, sum, error);
    return status;
}

/* Rounds up to two significant digits. */
static double round_up(double value)
{
    const double unit = pow(10.0, floor(log10(value)) - 1.0);
    return unit * ceil(value / unit - 1e-9);
}

/* Writes a remedy, as the end of a sentence. `named`: texels a metre or, if the user gives sizes, a side. */
static void name_remedy(const struct planner *p, double named, char *text, size_t size)
{
    if (!isfinite(named))
        (void)snprintf(text, size,
                       "no density is enough, because charts touch or lightmaps would be larger than --lightmap-max");
    else if (p->params.lightmap_size > 0)
        (void)snprintf(text, size, "--lightmap-size %.0f would leave less than 1 %%", named);
    else
        (void)snprintf(text, size, "--texels-per-metre %.3g would leave less than 1 %%%s", named,
                       p->params.texels_per_metre > 0.0 ? "" : ", which is more texels than automatic density spends");
}

static int note_padding(struct planner *p, struct kiln_error *error)
{
    struct padding_sum sum = {0};
    char remedy[192];
    int status = sum_padding(p, &sum, error);
    if (status == KILN_OK && sum.raised > 0)
        status = kiln_builder_note(
            p->builder, 0, error,
            "%zu object%s up to %.2g times the texels a metre that the scene's size would give, so that two texels lie "
            "between the charts of a layout",
            sum.raised, sum.raised == 1 ? " has" : "s have", sum.raise);
    if (status != KILN_OK || sum.close == 0)
        return status;
    const double factor = kiln_padding_factor(&sum.common, CLOSE_FRACTION);
    const double unit = p->params.lightmap_size > 0 ? p->params.lightmap_size : p->texels_per_metre,
                 wanted = factor * unit;
    const double named = isfinite(factor) ? p->params.lightmap_size > 0 ? ceil(wanted) : round_up(wanted) : INFINITY;
    p->builder->padding_factor = isfinite(factor) ? (float)(named / unit) : -1.0f;
    name_remedy(p, named, remedy, sizeof remedy);
    return kiln_builder_note(
        p->builder, 0, error,
        "in %zu of %zu lightmaps with several charts some lie less than two texels apart (%zu of %zu charts, along "
        "%.2g %% of "
        "the length of all borders, most in \"%s\": %.2g %%), and light bleeds from one to the other; %s%s",
        sum.close, sum.lightmaps, sum.all.close_charts, sum.all.charts, 100.0 * sum.all.close / sum.all.border,
        string(p, objects(p)[sum.worst].name), 100.0 * sum.worst_fraction, remedy,
        p->params.repack ? "" : "; --repack lays the charts out anew");
}

/* Appends the mesh's vertices, in its old or new layout, to the list of new vertices. */
static int collect_mesh(struct planner *p, size_t index, struct kiln_error *error)
{
    struct kiln_mesh *mesh = &meshes(p)[index];
    const struct kiln_unwrapped *u = p->plans[index].unwrapped;
    const uint64_t old_first = mesh->vertex_first;
    const size_t count = u != NULL ? u->vertex_count : mesh->vertex_count, first = p->vertex_count;
    int status = kiln_arena_grow(&p->arena, &p->source, &p->source_capacity, first + count, sizeof *p->source,
                                 "vertices of layouts", error);
    if (status == KILN_OK)
        status = kiln_arena_grow(&p->arena, &p->uv, &p->uv_capacity, first + count, sizeof *p->uv,
                                 "vertices of layouts", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < count; i++) {
        p->source[first + i] = old_first + (u != NULL ? u->source[i] : i);
        p->uv[first + i] = u != NULL ? u->uv[i] : lightmap_uv(p, mesh)[i];
    }
    if (u != NULL)
        memcpy(triangles(p, mesh), u->triangles, 3 * mesh->triangle_count * sizeof *u->triangles);
    mesh->vertex_first = first;
    mesh->vertex_count = count;
    p->vertex_count = first + count;
    return KILN_OK;
}

/* Reorders the vertices of one section to the new list. */
static int gather_section(struct planner *p, enum kiln_scene_section section, struct kiln_error *error)
{
    const size_t size = kiln_scene_element_size(section);
    unsigned char *data = NULL;
    const unsigned char *old = p->builder->sections[section].data;
    const int status = kiln_allocate(&data, p->vertex_count, size, "vertices of layouts", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < p->vertex_count; i++)
        memcpy(data + i * size, old + p->source[i] * size, size);
    kiln_free(&p->builder->sections[section].data);
    p->builder->sections[section].data = data;
    p->builder->sections[section].count = p->builder->sections[section].capacity = p->vertex_count;
    return KILN_OK;
}

static const enum kiln_scene_section VERTEX_SECTIONS[] = {
    KILN_SECTION_POSITIONS,         KILN_SECTION_NORMALS, KILN_SECTION_TEXCOORD_BASE,   KILN_SECTION_TEXCOORD_EMISSION,
    KILN_SECTION_TEXCOORD_LIGHTMAP, KILN_SECTION_COLORS,  KILN_SECTION_TEXCOORD_NORMAL, KILN_SECTION_TEXCOORD_GLOSS};
enum { VERTEX_SECTION_COUNT = sizeof VERTEX_SECTIONS / sizeof *VERTEX_SECTIONS };

/* Rewrites all vertex sections so that every mesh has the vertices of its layout. */
static int rebuild_vertices(struct planner *p, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < VERTEX_SECTION_COUNT; i++)
        if (kiln_builder_has(p->builder, VERTEX_SECTIONS[i]) &&
            p->builder->sections[VERTEX_SECTIONS[i]].count != p->builder->sections[KILN_SECTION_POSITIONS].count)
            return kiln_fail(error, KILN_BUG, "vertex section %d has %zu elements where there are %zu positions",
                             (int)VERTEX_SECTIONS[i], p->builder->sections[VERTEX_SECTIONS[i]].count,
                             p->builder->sections[KILN_SECTION_POSITIONS].count);
    for (size_t i = 0; i < mesh_count(p); i++)
        KILN_TRY(collect_mesh(p, i, error));
    for (size_t i = 0; i < VERTEX_SECTION_COUNT; i++)
        if (kiln_builder_has(p->builder, VERTEX_SECTIONS[i]))
            KILN_TRY(gather_section(p, VERTEX_SECTIONS[i], error));
    if (p->vertex_count > 0)
        memcpy(p->builder->sections[KILN_SECTION_TEXCOORD_LIGHTMAP].data, p->uv, p->vertex_count * sizeof *p->uv);
end:
    return status;
}

static int note_limited(struct planner *p, size_t index, double at_one, struct kiln_error *error)
{
    const struct kiln_object *object = &objects(p)[index];
    return kiln_builder_note(
        p->builder, 0, error,
        "object \"%s\" would take %.0f %% of all texels at the density of the others (%.3g texels a metre) and has "
        "%.3g "
        "texels a metre instead (density-scale for it, or --texels-per-metre for all, change that)",
        string(p, object->name), 100.0 * demand_of(p, index).texels / at_one, p->texels_per_metre, p->densities[index]);
}

/* Adds notes on objects whose automatic density differs from the common one. */
static int note_densities(struct planner *p, struct kiln_error *error)
{
    size_t small = 0, shared = 0;
    double at_one = 0.0; /* texels of all objects at one texel a metre */
    int status = KILN_OK;
    for (size_t i = 0; i < object_count(p); i++) {
        const double texels = demand_of(p, i).texels;
        at_one += isfinite(texels) ? texels : 0.0;
    }
    for (size_t i = 0; i < object_count(p); i++) {
        small += objects(p)[i].density_reason == KILN_DENSITY_LEAST;
        if (objects(p)[i].density_reason == KILN_DENSITY_FRACTION && note_wanted(&shared))
            KILN_TRY(note_limited(p, i, at_one, error));
    }
    if (small > 0)
        KILN_TRY(kiln_builder_note(p->builder, 0, error,
                                   "%zu small objects have more than the common %.3g texels a metre, so that their "
                                   "lightmaps are %u texels across, or as many as twice the density of the largest "
                                   "object gives them",
                                   small, p->texels_per_metre, p->density.least_side));
end:
    return status;
}

static int write_totals(struct planner *p, struct kiln_error *error)
{
    int status = KILN_OK;
    if (p->absent > 0)
        KILN_TRY(kiln_builder_note(p->builder, 0, error, "%zu of %zu meshes have no second UV set and are unwrapped",
                                   p->absent, mesh_count(p)));
    if (p->params.repack)
        KILN_TRY(
            kiln_builder_note(p->builder, 0, error,
                              "the charts of %zu of %zu meshes lie less than two texels apart and are laid out anew",
                              p->repacked, mesh_count(p)));
    if (p->parted > 0)
        KILN_TRY(kiln_builder_note(
            p->builder, 1, error,
            "the charts of %zu of %zu meshes would share texels, so that light of one would appear on another (%llu "
            "texels of %u x %u in \"%s\"): they are packed anew, and a viewer needs kiln's layout; finer lightmaps "
            "need no other, and --shared-texels keep keeps the file's",
            p->parted, mesh_count(p), (unsigned long long)p->most_shared, p->most_shared_size[0],
            p->most_shared_size[1], string(p, meshes(p)[p->most_shared_mesh].name)));
    if (p->refused > NOTES_MAX)
        KILN_TRY(
            kiln_builder_note(p->builder, 1, error, "%zu more second UV sets are refused", p->refused - NOTES_MAX));
    if (p->unclean > NOTES_MAX)
        KILN_TRY(kiln_builder_note(p->builder, 1, error, "%zu more second UV sets are not quite clean",
                                   p->unclean - NOTES_MAX));
    if (p->capped > NOTES_MAX)
        KILN_TRY(kiln_builder_note(p->builder, 1, error, "%zu more lightmaps are capped at %u texels a side",
                                   p->capped - NOTES_MAX, p->params.lightmap_max));
    if (p->shared > NOTES_MAX)
        KILN_TRY(kiln_builder_note(p->builder, 1, error, "%zu more meshes have charts that share texels",
                                   p->shared - NOTES_MAX));
end:
    return status;
}

/* Unwraps the meshes that need it. How many texels they need is known only once they are packed; then the density is
 * chosen again, until the sum is near the target and no object has too large a fraction. */
static int unwrap_all(struct planner *p, struct kiln_error *error)
{
    enum { ROUNDS = 3 };
    int status = KILN_OK;
    for (int round = 0; round < ROUNDS && status == KILN_OK; round++) {
        status = choose_densities(p, error);
        if (status != KILN_OK)
            return status;
        find_references(p);
        status = unwrap_meshes(p, error);
        if (p->params.texels_per_metre > 0.0 || p->params.lightmap_size > 0)
            break;
    }
    for (size_t i = 0; i < mesh_count(p) && status == KILN_OK; i++)
        if (p->plans[i].unwrap)
            status = note_packing(p, i, error);
    return status;
}

static int plan_layouts(struct planner *p, struct kiln_error *error)
{
    int status = KILN_OK;
    bool any = false;
    for (size_t i = 0; i < mesh_count(p) && status == KILN_OK; i++)
        status = check_mesh(p, i, error);
    if (status != KILN_OK)
        return status;
    measure_objects(p);
    find_ground(p);
    if (p->params.repack)
        status = choose_repacks(p, error);
    KILN_TRY(status);
    KILN_TRY(unwrap_all(p, error));
    if (p->params.texels_per_metre == 0.0 && p->params.lightmap_size == 0)
        KILN_TRY(raise_densities(p, error));
    if (p->params.repack || !p->params.keep_shared)
        KILN_TRY(part_shared(p, error));
    for (size_t i = 0; i < object_count(p); i++)
        KILN_TRY(size_object(p, i, error));
    KILN_TRY(check_texels(p, true, error));
    KILN_TRY(note_densities(p, error));
end:
    for (size_t i = 0; i < mesh_count(p); i++)
        any = any || p->plans[i].unwrap;
    if (status == KILN_OK && any)
        status = rebuild_vertices(p, error);
    if (status == KILN_OK)
        status = keep_backs_apart(p, error);
    if (status == KILN_OK)
        status = note_padding(p, error);
    if (status == KILN_OK)
        status = write_totals(p, error);
    p->builder->texels_per_metre = p->params.lightmap_size > 0 ? 0.0f : (float)p->texels_per_metre;
    return status;
}

static int check_params(struct kiln_layout_params *params, struct kiln_error *error)
{
    if (params->lightmap_max == 0)
        params->lightmap_max = DEFAULT_MAX;
    if (params->padding == 0)
        params->padding = DEFAULT_PADDING;
    if (!(params->texels > 0.0))
        params->texels = SCENE_TEXELS;
    if (params->lightmap_max > LARGEST_SIDE || params->lightmap_size > LARGEST_SIDE)
        return kiln_fail(
            error, KILN_USAGE, "the options ask for a lightmap of %u texels a side; at most %d are possible",
            params->lightmap_size > params->lightmap_max ? params->lightmap_size : params->lightmap_max, LARGEST_SIDE);
    if (!isfinite(params->texels_per_metre) || params->texels_per_metre < 0.0)
        return kiln_fail(error, KILN_USAGE, "the density is %g texels a metre; it must be a number above 0",
                         params->texels_per_metre);
    if (params->padding > 64)
        return kiln_fail(error, KILN_USAGE, "the options ask for a padding of %u texels; at most 64 are possible",
                         params->padding);
    return KILN_OK;
}

static void free_plan(struct mesh_plan *plan)
{
    kiln_unwrapped_destroy(&plan->unwrapped);
    kiln_free(&plan->paddings);
}

int kiln_layout(struct kiln_builder *builder, const struct kiln_layout_params *params, struct kiln_error *error)
{
    struct planner p = {.builder = builder, .params = *params};
    int status = check_params(&p.params, error);
    if (status != KILN_OK)
        return status;
    KILN_TRY(kiln_arena_allocate(&p.arena, &p.plans, mesh_count(&p), sizeof *p.plans, "layouts", error));
    KILN_TRY(kiln_arena_allocate(&p.arena, &p.measures, object_count(&p), sizeof *p.measures, "layouts", error));
    KILN_TRY(plan_layouts(&p, error));
end:
    for (size_t i = 0; p.plans != NULL && i < mesh_count(&p); i++)
        free_plan(&p.plans[i]);
    kiln_free(&p.density.of);
    kiln_arena_release(&p.arena);
    return status;
}
