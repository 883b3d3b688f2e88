/* Meshes: primitives to triangles. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/gltf_pose.h"

/* limits of triangles in posed meshes, which are stored once per node: a free number, and more per byte of the file */
enum { POSED_FREE = 1 << 20, POSED_PER_BYTE = 4 };

enum { POINTS = 0, LINES_LAST = 3, TRIANGLES = 4, STRIP = 5, FAN = 6 };

/* A primitive's accessors; NULL where absent. */
struct primitive {
    const struct gltf_accessor *indices, *position, *normal, *color, *base, *emission, *lightmap, *normal_map, *gloss;
    const struct gltf_material *material; /* NULL: the default material */
    const struct gltf_pose *pose;
    struct gltf_posed posed;
    unsigned mode;
    size_t corner_count;
    bool clamped_color, mirrored;                           /* mirrored: by its pose */
    struct gltf_accessor copies[GLTF_DRACO_ATTRIBUTES + 1]; /* copies of the accessors above, for compressed values */
    struct gltf_draco_values values;
};

const struct gltf_accessor *gltf_attribute(struct gltf *g, struct gltf_place place, const json_t *attributes,
                                           const char *name, unsigned low, unsigned high, size_t count)
{
    const uint32_t index = gltf_index(g, place, attributes, name, g->accessor_count);
    if (index == KILN_NONE)
        return NULL;
    const struct gltf_accessor *accessor = &g->accessors[index];
    if (accessor->components < low || accessor->components > high)
        gltf_fail(g, place, name, "is accessor %u, whose elements have %u components, not %u", index,
                  accessor->components, low);
    else if (count != 0 && accessor->count != count)
        gltf_fail(g, place, name, "is accessor %u with %zu elements, but POSITION has %zu", index, accessor->count,
                  count);
    return accessor;
}

static const struct gltf_accessor *texcoord(struct gltf *g, struct gltf_place place, const json_t *attributes,
                                            uint32_t set, size_t count)
{
    char name[32];
    (void)snprintf(name, sizeof name, "TEXCOORD_%u", set);
    return gltf_attribute(g, place, attributes, name, 2, 2, count);
}

void gltf_triangle(unsigned mode, const struct gltf_accessor *indices, size_t k, uint32_t corner[3])
{
    size_t at[3] = {3 * k, 3 * k + 1, 3 * k + 2};
    if (mode == STRIP) /* every other triangle of a strip has the opposite winding */
        at[0] = k, at[1] = k + 1 + k % 2, at[2] = k + 2 - k % 2;
    else if (mode == FAN) /* the specification's order: (k + 1, k + 2, 0) */
        at[0] = k + 1, at[1] = k + 2, at[2] = 0;
    for (int c = 0; c < 3; c++)
        corner[c] = indices == NULL ? (uint32_t)at[c] : gltf_accessor_index(indices, at[c]);
}

static bool is_posed(const struct primitive *p) { return p->pose->joints != NULL || p->posed.morph_count > 0; }

static void read_corners(void *context, size_t k, uint32_t corner[3])
{
    const struct primitive *p = context;
    gltf_triangle(p->mode, p->indices, k, corner);
    if (p->mirrored) {
        const uint32_t second = corner[1];
        corner[1] = corner[2];
        corner[2] = second;
    }
}

static void read_geometry(void *context, uint32_t vertex, struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    struct primitive *p = context;
    gltf_accessor_float(p->position, vertex, &position->x);
    if (p->normal != NULL)
        gltf_accessor_float(p->normal, vertex, &normal->x);
    if (is_posed(p))
        gltf_posed_move(p->pose, &p->posed, vertex, position, normal);
}

static struct kiln_vec2 transformed(const struct gltf_accessor *accessor, const float t[6], uint32_t vertex)
{
    float uv[2] = {0.0f, 0.0f};
    if (accessor != NULL)
        gltf_accessor_float(accessor, vertex, uv);
    return (struct kiln_vec2){t[0] * uv[0] + t[1] * uv[1] + t[2], t[3] * uv[0] + t[4] * uv[1] + t[5]};
}

static void read_attributes(void *context, uint32_t vertex, struct kiln_attributes *out)
{
    struct primitive *p = context;
    const struct gltf_material *m = p->material;
    const bool base = m != NULL && m->base.texture != KILN_NONE,
               emission = m != NULL && m->emission.texture != KILN_NONE;
    /* a coordinate set that no texture uses is a copy of the other one, so that a mesh has two sets only if needed */
    if (base)
        out->base = transformed(p->base, m->base.transform, vertex);
    out->emission = emission ? transformed(p->emission, m->emission.transform, vertex) : out->base;
    if (!base)
        out->base = out->emission;
    out->normal = m != NULL && m->normal.texture != KILN_NONE ? transformed(p->normal_map, m->normal.transform, vertex)
                                                              : out->base;
    out->gloss =
        m != NULL && m->gloss.texture != KILN_NONE ? transformed(p->gloss, m->gloss.transform, vertex) : out->base;
    if (p->lightmap != NULL)
        gltf_accessor_float(p->lightmap, vertex, &out->lightmap.x);
    if (p->color == NULL)
        return;
    float color[4] = {1.0f, 1.0f, 1.0f, 1.0f};
    gltf_accessor_float(p->color, vertex, color);
    for (int c = 0; c < 4; c++) {
        p->clamped_color |= !(color[c] >= 0.0f && color[c] <= 1.0f);
        out->color[c] = (uint8_t)(fminf(fmaxf(color[c], 0.0f), 1.0f) * 255.0f + 0.5f);
    }
}

static void read_indices(struct gltf *g, struct gltf_place place, const json_t *json, struct primitive *p)
{
    const uint32_t index = gltf_index(g, place, json, "indices", g->accessor_count);
    p->corner_count = p->position == NULL ? 0 : p->position->count;
    if (index == KILN_NONE)
        return;
    p->indices = &g->accessors[index];
    p->corner_count = p->indices->count;
    const unsigned c = p->indices->component;
    if (p->indices->components != 1 || p->indices->normalized || (c != 5121 && c != 5123 && c != 5125))
        gltf_fail(g, place, "indices", "is accessor %u, which is not SCALAR of unsigned integers", index);
}

static void read_primitive(struct gltf *g, struct gltf_place place, const json_t *json, struct primitive *p,
                           uint32_t *material)
{
    const json_t *attributes = gltf_object(g, place, json, "attributes");
    if (g->status == KILN_OK && attributes == NULL)
        gltf_fail(g, place, "attributes", "is missing");
    p->mode = (unsigned)gltf_whole(g, place, json, "mode", POINTS, FAN, TRIANGLES);
    p->position = gltf_attribute(g, place, attributes, "POSITION", 3, 3, 0);
    if (g->status == KILN_OK && p->position == NULL)
        gltf_fail(g, place, "attributes.POSITION", "is missing");
    if (g->status != KILN_OK)
        return;
    const size_t count = p->position->count;
    p->normal = gltf_attribute(g, place, attributes, "NORMAL", 3, 3, count);
    p->color = gltf_attribute(g, place, attributes, "COLOR_0", 3, 4, count);
    p->lightmap = texcoord(g, place, attributes, 1, count);
    read_indices(g, place, json, p);
    gltf_posed_read(g, place, json, p->pose, count, &p->posed);
    *material = gltf_index(g, place, json, "material", g->material_count);
    if (*material == KILN_NONE || g->status != KILN_OK)
        return;
    p->material = &g->materials[*material];
    if (p->material->base.texture != KILN_NONE)
        p->base = texcoord(g, place, attributes, p->material->base.texcoord, count);
    if (p->material->emission.texture != KILN_NONE)
        p->emission = texcoord(g, place, attributes, p->material->emission.texcoord, count);
    if (p->material->normal.texture != KILN_NONE)
        p->normal_map = texcoord(g, place, attributes, p->material->normal.texcoord, count);
    if (p->material->gloss.texture != KILN_NONE)
        p->gloss = texcoord(g, place, attributes, p->material->gloss.texcoord, count);
    g->missing_gloss_texcoords += p->material->gloss.texture != KILN_NONE && p->gloss == NULL;
    g->missing_normal_texcoords += p->material->normal.texture != KILN_NONE && p->normal_map == NULL;
    g->missing_texcoords += (p->material->base.texture != KILN_NONE && p->base == NULL) ||
                            (p->material->emission.texture != KILN_NONE && p->emission == NULL);
}

/* Replaces the accessors that a primitive uses by copies with the values that its Draco extension decodes. The indices
 * are replaced, too. */
static void decompress(struct gltf *g, struct gltf_place place, const json_t *json, struct primitive *p)
{
    char base[32], emission[32], normal[32], gloss[32];
    (void)snprintf(base, sizeof base, "TEXCOORD_%u", p->material == NULL ? 0 : p->material->base.texcoord);
    (void)snprintf(emission, sizeof emission, "TEXCOORD_%u", p->material == NULL ? 0 : p->material->emission.texcoord);
    (void)snprintf(normal, sizeof normal, "TEXCOORD_%u", p->material == NULL ? 0 : p->material->normal.texcoord);
    (void)snprintf(gloss, sizeof gloss, "TEXCOORD_%u", p->material == NULL ? 0 : p->material->gloss.texcoord);
    const struct {
        const char *name;
        const struct gltf_accessor **accessor;
    } used[GLTF_DRACO_ATTRIBUTES] = {{"POSITION", &p->position},
                                     {"NORMAL", &p->normal},
                                     {"COLOR_0", &p->color},
                                     {"TEXCOORD_1", &p->lightmap},
                                     {base, &p->base},
                                     {emission, &p->emission},
                                     {normal, &p->normal_map},
                                     {gloss, &p->gloss},
                                     {"JOINTS_0", &p->posed.joints[0]},
                                     {"WEIGHTS_0", &p->posed.weights[0]},
                                     {"JOINTS_1", &p->posed.joints[1]},
                                     {"WEIGHTS_1", &p->posed.weights[1]}};
    struct gltf_draco_use uses[GLTF_DRACO_ATTRIBUTES];
    if (p->mode != TRIANGLES) {
        gltf_fail(g, place, "mode", "is %u; with Draco kiln reads triangles (4)", p->mode);
        return;
    }
    struct gltf_accessor *indices = &p->copies[GLTF_DRACO_ATTRIBUTES];
    if (p->indices != NULL)
        *indices = *p->indices;
    for (size_t i = 0; i < GLTF_DRACO_ATTRIBUTES; i++) {
        if (*used[i].accessor != NULL)
            p->copies[i] = **used[i].accessor;
        uses[i] = (struct gltf_draco_use){used[i].name, &p->copies[i]};
    }
    gltf_read_draco(g, place, json, uses, GLTF_DRACO_ATTRIBUTES, indices, &p->values);
    for (size_t i = 0; i < GLTF_DRACO_ATTRIBUTES; i++)
        if (*used[i].accessor != NULL)
            *used[i].accessor = &p->copies[i];
    p->indices = indices;
}

static size_t triangle_count(const struct primitive *p)
{
    if (p->mode == TRIANGLES)
        return p->corner_count / 3;
    return p->corner_count < 3 ? 0 : p->corner_count - 2;
}

/* Appends primitive number `index` of the mesh; *lacks_lightmap_uv tells whether its triangles have no lightmap
 * coordinate. */
static void store_primitive(struct gltf *g, struct gltf_place place, struct primitive *p, uint32_t material,
                            uint32_t mesh, uint32_t index, bool *lacks_lightmap_uv)
{
    const size_t triangles = triangle_count(p);
    if (p->mode == TRIANGLES && p->corner_count % 3 != 0) {
        gltf_fail(g, place, "indices", "has %zu corners, which is not a multiple of 3", p->corner_count);
        return;
    }
    const bool own = gltf_pose_is_own(p->pose);
    g->triangles += own ? 0 : triangles;
    g->posed_triangles += own ? triangles : 0;
    if (g->triangles > 65536 + g->confine->total_bytes + g->draco_triangles || triangles > UINT32_MAX ||
        g->posed_triangles > POSED_FREE + POSED_PER_BYTE * g->confine->total_bytes + g->draco_triangles) {
        gltf_fail(g, place, "", "brings the scene to %llu triangles, more than files of its size can hold",
                  (unsigned long long)(g->triangles + g->posed_triangles));
        return;
    }
    p->mirrored = p->position->count > 0 && gltf_posed_mirrors(p->pose, &p->posed, 0);
    if (material == KILN_NONE) {
        g->without_material++;
        material = gltf_default_material(g);
    }
    char where[640];
    (void)snprintf(where, sizeof where, "%.512s: %s[%zu]%s", g->confine->scene, place.array, place.index, place.below);
    const struct kiln_primitive primitive = {.where = where,
                                             .context = p,
                                             .vertex_count = p->position->count,
                                             .triangle_count = triangles,
                                             .has_normals = p->normal != NULL,
                                             .posed = is_posed(p),
                                             .turned = p->mirrored,
                                             .material = material,
                                             .index = index,
                                             .corners = read_corners,
                                             .geometry = read_geometry,
                                             .attributes = read_attributes};
    if (g->status == KILN_OK)
        gltf_take(g, kiln_mesh_add(g->builder, mesh, &primitive, &g->assembly, g->error));
    if (p->posed.wrong_joint)
        gltf_fail(g, place, "attributes.JOINTS_0", "names a joint beyond the %zu of its skin", p->pose->joint_count);
    g->clamped_colors += p->clamped_color;
    *lacks_lightmap_uv |= triangles > 0 && p->lightmap == NULL;
}

static void add_primitive(struct gltf *g, struct gltf_place place, const json_t *json, const struct gltf_pose *pose,
                          uint32_t mesh, uint32_t index, bool *lacks_lightmap_uv)
{
    struct primitive p = {.pose = pose};
    uint32_t material = KILN_NONE;
    read_primitive(g, place, json, &p, &material);
    const bool lines = g->status == KILN_OK && p.mode <= LINES_LAST;
    g->points_and_lines += lines;
    if (g->status == KILN_OK && !lines && gltf_extension(g, place, json, "KHR_draco_mesh_compression") != NULL)
        decompress(g, place, json, &p);
    if (g->status == KILN_OK && !lines)
        store_primitive(g, place, &p, material, mesh, index, lacks_lightmap_uv);
    gltf_posed_free(&p.posed);
    gltf_draco_values_free(&p.values);
}

uint32_t gltf_mesh(struct gltf *g, uint32_t index, const struct gltf_pose *pose)
{
    const struct gltf_place place = {"meshes", index, ""};
    const bool own = gltf_pose_is_own(pose);
    if (g->status != KILN_OK)
        return KILN_NONE;
    if (g->mesh_of[index] != GLTF_UNREAD && !own)
        return g->mesh_of[index];
    const json_t *json = gltf_element(g, "meshes", index);
    const json_t *primitives = gltf_array(g, place, json, "primitives");
    const char *name = gltf_string(g, place, json, "name");
    if (g->status == KILN_OK && json_array_size(primitives) == 0)
        gltf_fail(g, place, "primitives", "is empty or missing");
    if (g->status != KILN_OK)
        return KILN_NONE;
    uint32_t mesh = KILN_NONE;
    bool lacks_lightmap_uv = false;
    gltf_take(g, kiln_mesh_begin(g->builder, name == NULL ? "" : name, &mesh, g->error));
    for (size_t i = 0; i < json_array_size(primitives) && g->status == KILN_OK; i++) {
        char below[40];
        (void)snprintf(below, sizeof below, ".primitives[%zu]", i);
        const struct gltf_place at = {"meshes", index, below};
        const json_t *primitive = json_array_get(primitives, i);
        if (json_is_object(primitive))
            add_primitive(g, at, primitive, pose, mesh, (uint32_t)i, &lacks_lightmap_uv);
        else
            gltf_fail(g, at, "", "is not an object");
    }
    if (g->status != KILN_OK)
        return KILN_NONE;
    if (KILN_BUILDER_DATA(g->builder, struct kiln_mesh, KILN_SECTION_MESHES)[mesh].triangle_count == 0) {
        g->builder->sections[KILN_SECTION_MESHES].count--; /* nothing of the mesh was stored */
        mesh = KILN_NONE;
    } else {
        g->builder->mesh_has_lightmap_uv[mesh] = !lacks_lightmap_uv;
    }
    if (!own)
        g->mesh_of[index] = mesh;
    return mesh;
}
