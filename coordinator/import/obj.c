#include "coordinator/import/obj.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <xxhash.h>

#include "coordinator/import/assemble.h"
#include "coordinator/import/names.h"
#include "coordinator/import/obj_document.h"
#include "coordinator/import/obj_polygon.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* A face corner: indices of its position, texture coordinate and normal; KILN_NONE: not given. */
struct corner {
    uint32_t position, texcoord, normal;
};

/* The values by which corners are compared. */
struct corner_value {
    struct kiln_dvec3 position;
    struct kiln_vec3 normal;
    struct kiln_vec2 texcoord;
    uint8_t color[4];
};

/* A run of consecutive faces of one object and material. */
struct face_run {
    size_t corner_first, corner_count, triangle_first, triangle_count;
    uint32_t material;
    uint32_t next; /* the next run of the same object, or KILN_NONE */
    bool normals, texcoords;
};

struct object {
    size_t name;          /* into names_text */
    uint32_t first, last; /* its first and last run of faces, or KILN_NONE */
};

struct reader {
    struct kiln_confine *confine;
    struct kiln_builder *builder;
    struct kiln_error *error;
    struct obj_text text;
    struct obj_materials materials;
    /* the file's vertex data */
    struct kiln_dvec3 *positions; /* in doubles: map coordinates have more digits than a float */
    struct kiln_vec3 *normals;
    struct kiln_vec2 *texcoords;
    uint8_t (*colors)[4]; /* NULL: no vertex has a colour */
    size_t position_count, position_capacity, normal_count, normal_capacity, texcoord_count, texcoord_capacity,
        color_count, color_capacity;
    /* faces; indices are relative to their run of faces */
    struct corner *corners;
    uint32_t (*triangles)[3];
    size_t corner_count, corner_capacity, triangle_count, triangle_capacity;
    uint32_t *slots; /* hash table of the current run's corners: index + 1; entries outside the run count as free */
    size_t slot_count;
    struct obj_polygon polygon;
    uint32_t *face; /* corners of the face being read */
    size_t face_capacity;
    struct face_run *face_runs;
    struct object *objects;
    size_t face_run_count, face_run_capacity, object_count, object_capacity;
    char *names_text;
    size_t names_size, names_capacity;
    struct obj_symbols object_names;
    struct kiln_names names;
    struct kiln_assembly_counts assembly;
    size_t group;    /* name of the active group, into names_text */
    uint32_t object; /* KILN_NONE: none yet */
    uint32_t material;
    bool face_run_open; /* the next face belongs to the last run */
    uint64_t lines, free_form, strange, strange_line, without_area_objects;
    char strange_word[41];
    struct kiln_arena arena;
};

/* ---- v, vt, vn ---- */

/* Makes room for one more element in a list. Faces count its elements from 1. */
static int room(struct reader *r, void *list, size_t *capacity, size_t count, size_t size, const char *what)
{
    if (count >= KILN_NONE)
        return obj_fail(&r->text, "more than 2^32 - 1 elements of one kind", NULL);
    return kiln_grow(list, capacity, count + 1, size, what, r->error);
}

/* Adds a vertex colour. Vertices before the first one with a colour are white. */
static int add_color(struct reader *r, const double *rgb)
{
    const int status = kiln_arena_grow(&r->arena, &r->colors, &r->color_capacity, r->position_count, sizeof *r->colors,
                                       "vertex colours", r->error);
    if (status != KILN_OK)
        return status;
    memset(r->colors + r->color_count, 255, (r->position_count - r->color_count) * sizeof *r->colors);
    for (size_t c = 0; c < 3 && rgb != NULL; c++)
        r->colors[r->position_count - 1][c] = (uint8_t)((float)fmin(fmax(rgb[c], 0.0), 1.0) * 255.0f + 0.5f);
    r->color_count = r->position_count;
    return KILN_OK;
}

static int read_position(struct reader *r)
{
    double n[6];
    size_t count;
    int status = obj_numbers(&r->text, "v", n, 3, 6, &count);
    if (status == KILN_OK && count == 5)
        return obj_fail(&r->text, "five numbers after v: neither x y z w nor x y z and a colour", NULL);
    if (status == KILN_OK)
        status = room(r, &r->positions, &r->position_capacity, r->position_count, sizeof *r->positions, "vertices");
    if (status != KILN_OK)
        return status;
    const double w = count == 4 ? n[3] : 1.0;
    const struct kiln_dvec3 p = dvec3(n[0] / w, n[1] / w, n[2] / w);
    if (!isfinite((float)p.x) || !isfinite((float)p.y) || !isfinite((float)p.z))
        return obj_fail(&r->text, "a vertex whose w is 0 or nearly 0, which makes it infinite", NULL);
    r->positions[r->position_count++] = dvec3_add(p, dvec3(0.0, 0.0, 0.0)); /* 0 and -0 are equal */
    return count == 6 || r->color_count > 0 ? add_color(r, count == 6 ? n + 3 : NULL) : KILN_OK;
}

static int read_texcoord(struct reader *r)
{
    double n[3] = {0};
    size_t count;
    int status;
    KILN_TRY(obj_numbers(&r->text, "vt", n, 1, 3, &count));
    KILN_TRY(
        room(r, &r->texcoords, &r->texcoord_capacity, r->texcoord_count, sizeof *r->texcoords, "texture coordinates"));
    r->texcoords[r->texcoord_count++] = (struct kiln_vec2){(float)n[0], (float)n[1]};
end:
    return status;
}

static int read_normal(struct reader *r)
{
    double n[3];
    size_t count;
    int status;
    KILN_TRY(obj_numbers(&r->text, "vn", n, 3, 3, &count));
    KILN_TRY(room(r, &r->normals, &r->normal_capacity, r->normal_count, sizeof *r->normals, "normals"));
    r->normals[r->normal_count++] = vec3_add(vec3((float)n[0], (float)n[1], (float)n[2]), vec3(0.0f, 0.0f, 0.0f));
end:
    return status;
}

/* ---- objects, groups, materials ---- */

static int keep_name(struct reader *r, struct obj_word name, size_t *offset)
{
    const int status = kiln_arena_grow(&r->arena, &r->names_text, &r->names_capacity, r->names_size + name.length + 1,
                                       1, "names", r->error);
    if (status != KILN_OK)
        return status;
    memcpy(r->names_text + r->names_size, name.text, name.length);
    r->names_text[r->names_size + name.length] = '\0';
    *offset = r->names_size;
    r->names_size += name.length + 1;
    return KILN_OK;
}

static int open_object(struct reader *r, struct obj_word name)
{
    uint32_t known = (uint32_t)r->object_count;
    if (r->object_count >= KILN_NONE)
        return obj_fail(&r->text, "more than 2^32 - 1 objects", NULL);
    int status = kiln_arena_grow(&r->arena, &r->objects, &r->object_capacity, r->object_count + 1, sizeof *r->objects,
                                 "objects", r->error);
    if (status == KILN_OK)
        status = obj_symbol(&r->object_names, name.text, name.length, &known, r->error);
    struct object object = {.first = KILN_NONE, .last = KILN_NONE};
    if (status == KILN_OK)
        status = keep_name(r, name, &object.name);
    if (status != KILN_OK)
        return status;
    r->object = (uint32_t)r->object_count;
    r->objects[r->object_count++] = object;
    r->face_run_open = false;
    return KILN_OK;
}

static int read_object(struct reader *r)
{
    const struct obj_word name = obj_rest(&r->text);
    uint32_t known = KILN_NONE;
    if (name.length == 0)
        return KILN_OK;
    /* a new name gets the index of the object that it will name */
    known = (uint32_t)r->object_count;
    const int status = obj_symbol(&r->object_names, name.text, name.length, &known, r->error);
    if (status != KILN_OK || known == r->object_count)
        return status != KILN_OK ? status : open_object(r, name);
    r->face_run_open = r->face_run_open && known == r->object;
    r->object = known;
    return KILN_OK;
}

static int read_group(struct reader *r)
{
    const struct obj_word name = obj_rest(&r->text);
    if (obj_is(name, r->names_text + r->group))
        return KILN_OK;
    const int status = open_object(r, name);
    r->group = status == KILN_OK ? r->objects[r->object].name : 0;
    return status;
}

static int read_use(struct reader *r)
{
    uint32_t material = 0;
    const int status = obj_find_material(&r->materials, obj_rest(&r->text), &material);
    r->face_run_open = r->face_run_open && material == r->material;
    r->material = material;
    return status;
}

static int read_libraries(struct reader *r)
{
    const struct obj_word names = obj_rest(&r->text);
    return names.length == 0 ? obj_fail(&r->text, "mtllib without the name of a file", NULL)
                             : obj_read_libraries(&r->materials, names);
}

static int open_part(struct reader *r)
{
    int status = KILN_OK;
    if (r->face_run_open)
        return KILN_OK;
    if (r->face_run_count >= KILN_NONE)
        return obj_fail(&r->text, "more than 2^32 - 1 changes of object and material", NULL);
    if (r->object == KILN_NONE)
        status = open_object(r, (struct obj_word){"defaultobject", 13});
    if (status == KILN_OK)
        status = kiln_arena_grow(&r->arena, &r->face_runs, &r->face_run_capacity, r->face_run_count + 1,
                                 sizeof *r->face_runs, "faces of one material", r->error);
    if (status != KILN_OK)
        return status;
    const uint32_t index = (uint32_t)r->face_run_count++;
    struct object *object = &r->objects[r->object];
    r->face_runs[index] = (struct face_run){.corner_first = r->corner_count,
                                            .triangle_first = r->triangle_count,
                                            .material = r->material,
                                            .next = KILN_NONE};
    if (object->last == KILN_NONE)
        object->first = index;
    else
        r->face_runs[object->last].next = index;
    object->last = index;
    r->face_run_open = true;
    return KILN_OK;
}

/* ---- f ---- */

static struct corner_value value_of(const struct reader *r, const struct corner *corner)
{
    struct corner_value value;
    memset(&value, 0, sizeof value);
    value.position = r->positions[corner->position];
    if (corner->normal != KILN_NONE)
        value.normal = r->normals[corner->normal];
    if (corner->texcoord != KILN_NONE)
        value.texcoord = r->texcoords[corner->texcoord];
    if (corner->position < r->color_count)
        memcpy(value.color, r->colors[corner->position], sizeof value.color);
    else
        memset(value.color, 255, sizeof value.color);
    return value;
}

static size_t first_slot(const struct reader *r, const struct corner_value *value)
{
    return (size_t)XXH3_64bits(value, sizeof *value) & (r->slot_count - 1);
}

static bool is_free(const struct reader *r, size_t slot, const struct face_run *face_run)
{
    return r->slots[slot] <= face_run->corner_first;
}

/* Doubles the table and enters the run's corners again. */
static int grow_slots(struct reader *r, const struct face_run *face_run)
{
    kiln_arena_free(&r->arena, &r->slots);
    r->slot_count = r->slot_count == 0 ? 256 : 2 * r->slot_count;
    const int status =
        kiln_arena_allocate(&r->arena, &r->slots, r->slot_count, sizeof *r->slots, "the corners of faces", r->error);
    for (size_t i = 0; status == KILN_OK && i < face_run->corner_count; i++) {
        const struct corner_value value = value_of(r, &r->corners[face_run->corner_first + i]);
        size_t slot = first_slot(r, &value);
        while (!is_free(r, slot, face_run))
            slot = (slot + 1) & (r->slot_count - 1);
        r->slots[slot] = (uint32_t)(face_run->corner_first + i + 1);
    }
    return status;
}

/* The index, within its run of faces, of a corner with these values; a new corner is appended. */
static int find_corner(struct reader *r, const struct corner *corner, uint32_t *index)
{
    struct face_run *face_run = &r->face_runs[r->face_run_count - 1];
    if (2 * (face_run->corner_count + 1) > r->slot_count) {
        const int grown = grow_slots(r, face_run);
        if (grown != KILN_OK)
            return grown;
    }
    const struct corner_value value = value_of(r, corner);
    size_t slot = first_slot(r, &value);
    for (; !is_free(r, slot, face_run); slot = (slot + 1) & (r->slot_count - 1)) {
        const struct corner_value other = value_of(r, &r->corners[r->slots[slot] - 1]);
        if (memcmp(&other, &value, sizeof value) == 0) {
            *index = (uint32_t)(r->slots[slot] - 1 - face_run->corner_first);
            return KILN_OK;
        }
    }
    const int status =
        room(r, &r->corners, &r->corner_capacity, r->corner_count, sizeof *r->corners, "the corners of faces");
    if (status != KILN_OK)
        return status;
    r->corners[r->corner_count++] = *corner;
    r->slots[slot] = (uint32_t)r->corner_count;
    *index = (uint32_t)face_run->corner_count++;
    return KILN_OK;
}

/* Parses one index of a corner and moves *at behind it. Returns false if it is no number, or out of range. */
static bool parse_index(const char **at, const char *end, size_t count, uint32_t *index)
{
    const bool back = *at < end && **at == '-';
    const char *first = *at + (back || (*at < end && **at == '+'));
    uint64_t value = 0;
    for (*at = first; *at < end && **at >= '0' && **at <= '9'; ++*at)
        value = value > UINT32_MAX ? value : 10 * value + (uint64_t)(**at - '0');
    if (*at == first || value == 0 || value > count)
        return false;
    *index = (uint32_t)(back ? count - value : value - 1);
    return true;
}

/* Number of a text's bytes that a sentence repeats. */
static int shown(size_t length, int most) { return length < (size_t)most ? (int)length : most; }

/* Parses "7", "7/1", "7//3" or "7/1/3". */
static int parse_corner(struct reader *r, struct obj_word word, struct corner *corner)
{
    static const char *const kinds[3] = {"v", "vt", "vn"};
    const size_t counts[3] = {r->position_count, r->texcoord_count, r->normal_count};
    uint32_t indices[3] = {KILN_NONE, KILN_NONE, KILN_NONE};
    const char *at = word.text, *end = at + word.length;
    for (int kind = 0; kind < 3; kind++) {
        const char *first = at;
        if ((kind == 0 || (at < end && *at != '/')) && !parse_index(&at, end, counts[kind], &indices[kind])) {
            return kiln_fail(
                r->error, KILN_BAD_INPUT,
                "%.512s: line %llu: face corner '%.*s' names %s %.*s of %zu; repair the file or export it again",
                r->confine->scene, (unsigned long long)r->text.line, shown(word.length, 40), word.text, kinds[kind],
                shown((size_t)(end - first), 20), first, counts[kind]);
        }
        if (at == end)
            break;
        if (*at != '/' || kind == 2)
            return obj_fail(&r->text, "not a face corner:", &word);
        at++;
    }
    *corner = (struct corner){indices[0], indices[1], indices[2]};
    return KILN_OK;
}

static int add_triangles(struct reader *r, size_t count)
{
    struct face_run *face_run = &r->face_runs[r->face_run_count - 1];
    if (!obj_polygon_cut(&r->polygon, count))
        return obj_fail(&r->text, "a face that is not convex and has more than 4096 corners; cut it into triangles",
                        NULL);
    const int status = kiln_arena_grow(&r->arena, &r->triangles, &r->triangle_capacity, r->triangle_count + count - 2,
                                       sizeof *r->triangles, "triangles", r->error);
    if (status != KILN_OK)
        return status;
    for (size_t k = 0; k < count - 2; k++)
        for (size_t c = 0; c < 3; c++)
            r->triangles[r->triangle_count + k][c] = r->face[r->polygon.triangles[3 * k + c]];
    r->triangle_count += count - 2;
    face_run->triangle_count += count - 2;
    return KILN_OK;
}

static int read_face(struct reader *r)
{
    struct obj_word word;
    size_t count = 0;
    int status = open_part(r);
    struct face_run *face_run = status == KILN_OK ? r->face_runs + r->face_run_count - 1 : NULL;
    for (; status == KILN_OK && obj_next_word(&r->text, &word); count++) {
        struct corner corner;
        status = parse_corner(r, word, &corner);
        if (status == KILN_OK)
            status = obj_polygon_room(&r->polygon, count + 1, r->error);
        if (status == KILN_OK)
            status = kiln_arena_grow(&r->arena, &r->face, &r->face_capacity, count + 1, sizeof *r->face,
                                     "the corners of a face", r->error);
        if (status == KILN_OK)
            status = find_corner(r, &corner, &r->face[count]);
        if (status != KILN_OK)
            return status;
        r->polygon.points[count] = r->positions[corner.position];
        face_run->normals |= corner.normal != KILN_NONE;
        face_run->texcoords |= corner.texcoord != KILN_NONE;
    }
    r->lines += count < 3;
    return status != KILN_OK || count < 3 ? status : add_triangles(r, count);
}

/* ---- the file ---- */

static int read_line(struct reader *r)
{
    r->lines++;
    return KILN_OK;
}

static int read_free_form(struct reader *r)
{
    r->free_form++;
    return KILN_OK;
}

static int read_nothing(struct reader *r)
{
    (void)r;
    return KILN_OK;
}

static const struct {
    const char *keyword;
    int (*read)(struct reader *r);
} statements[] = {
    {"v", read_position},        {"vt", read_texcoord},    {"vn", read_normal},        {"f", read_face},
    {"fo", read_face},           {"usemtl", read_use},     {"g", read_group},          {"o", read_object},
    {"mtllib", read_libraries},  {"l", read_line},         {"p", read_line},           {"s", read_nothing},
    {"lod", read_nothing},       {"bevel", read_nothing},  {"c_interp", read_nothing}, {"d_interp", read_nothing},
    {"mg", read_nothing},        {"usemap", read_nothing}, {"maplib", read_nothing},   {"shadow_obj", read_nothing},
    {"trace_obj", read_nothing}, {"vp", read_free_form},   {"cstype", read_free_form}, {"deg", read_free_form},
    {"bmat", read_free_form},    {"step", read_free_form}, {"curv", read_free_form},   {"curv2", read_free_form},
    {"surf", read_free_form},    {"parm", read_free_form}, {"trim", read_free_form},   {"hole", read_free_form},
    {"scrv", read_free_form},    {"sp", read_free_form},   {"end", read_free_form},    {"con", read_free_form}};

static int read_statement(struct reader *r, struct obj_word keyword)
{
    for (size_t i = 0; i < sizeof statements / sizeof statements[0]; i++)
        if (obj_is(keyword, statements[i].keyword))
            return statements[i].read(r);
    if (r->strange++ == 0) {
        r->strange_line = r->text.line;
        (void)snprintf(r->strange_word, sizeof r->strange_word, "%.*s", keyword.length < 40 ? (int)keyword.length : 40,
                       keyword.text);
    }
    return KILN_OK;
}

static int read_text(struct reader *r)
{
    struct kiln_file file;
    struct obj_word keyword;
    int status = kiln_confine_map(r->confine, r->builder, r->confine->name, "the scene", &file, r->error);
    if (status != KILN_OK)
        return status;
    status = obj_text_open(&r->text, &file, r->confine->scene, "", r->error);
    while (status == KILN_OK && obj_next_line(&r->text, &keyword))
        status = read_statement(r, keyword);
    obj_text_close(&r->text);
    kiln_file_unmap(&file);
    if (status == KILN_OK && r->triangle_count == 0)
        status = kiln_fail(r->error, KILN_BAD_INPUT,
                           "%.512s: it has no face among its %zu vertices; there is nothing to bake", r->confine->scene,
                           r->position_count);
    return status;
}

/* ---- into the builder ---- */

struct view {
    const struct reader *reader;
    const struct face_run *face_run;
    const struct obj_material *material;
    struct kiln_dvec3 centre; /* subtracted from positions */
};

static void give_corners(void *context, size_t k, uint32_t corner[3])
{
    const struct view *view = context;
    memcpy(corner, view->reader->triangles[view->face_run->triangle_first + k], 3 * sizeof *corner);
}

static void give_geometry(void *context, uint32_t v, struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    const struct view *view = context;
    const struct corner_value value = value_of(view->reader, &view->reader->corners[view->face_run->corner_first + v]);
    *position = vec3_of(dvec3_sub(value.position, view->centre));
    *normal = value.normal;
}

static struct kiln_vec2 mapped(struct kiln_vec2 t, const struct obj_map *map)
{
    if (map->moved)
        t = (struct kiln_vec2){map->scale[0] * t.x + map->offset[0], map->scale[1] * t.y + map->offset[1]};
    return (struct kiln_vec2){t.x, 1.0f - t.y};
}

static void give_attributes(void *context, uint32_t v, struct kiln_attributes *out)
{
    const struct view *view = context;
    const struct corner_value value = value_of(view->reader, &view->reader->corners[view->face_run->corner_first + v]);
    memcpy(out->color, value.color, sizeof value.color);
    if (!view->face_run->texcoords)
        return;
    out->base = mapped(value.texcoord, &view->material->diffuse_map);
    out->emission =
        view->material->emission_map.path != 0 ? mapped(value.texcoord, &view->material->emission_map) : out->base;
    out->lightmap = (struct kiln_vec2){value.texcoord.x, 1.0f - value.texcoord.y};
    out->gloss = view->material->glossy ? out->lightmap : out->base;
}

static int add_part(struct reader *r, const char *name, uint32_t mesh, const struct face_run *face_run,
                    struct kiln_dvec3 centre)
{
    char where[640];
    struct view view = {r, face_run, &r->materials.list[face_run->material], centre};
    (void)snprintf(where, sizeof where, "%.512s: object '%.80s'", r->confine->scene, name);
    const struct kiln_primitive primitive = {.where = where,
                                             .context = &view,
                                             .vertex_count = face_run->corner_count,
                                             .triangle_count = face_run->triangle_count,
                                             .has_normals = face_run->normals,
                                             .material = face_run->material,
                                             .corners = give_corners,
                                             .geometry = give_geometry,
                                             .attributes = give_attributes};
    return kiln_mesh_add(r->builder, mesh, &primitive, &r->assembly, r->error);
}

/* The centre of an object's box, in whole units, if the object is so far from the origin for its size that floats would
 * lose more than 16 bits of it; else the origin. */
static struct kiln_dvec3 centre_of(const struct reader *r, const struct object *object)
{
    const double far_away = 128.0;
    struct kiln_dvec3 low = dvec3(INFINITY, INFINITY, INFINITY), high = dvec3(-INFINITY, -INFINITY, -INFINITY);
    for (uint32_t i = object->first; i != KILN_NONE; i = r->face_runs[i].next) {
        const struct face_run *run = &r->face_runs[i];
        for (size_t c = run->corner_first; c < run->corner_first + run->corner_count; c++) {
            const struct kiln_dvec3 p = r->positions[r->corners[c].position];
            low = dvec3(fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z));
            high = dvec3(fmax(high.x, p.x), fmax(high.y, p.y), fmax(high.z, p.z));
        }
    }
    const struct kiln_dvec3 size = dvec3_sub(high, low), middle = dvec3_scale(dvec3_add(low, high), 0.5);
    const double largest = fmax(size.x, fmax(size.y, size.z)),
                 distance = fmax(fabs(middle.x), fmax(fabs(middle.y), fabs(middle.z)));
    if (!(largest > 0.0) || !(distance > far_away * largest))
        return dvec3(0.0, 0.0, 0.0);
    const double step = exp2(floor(log2(largest))); /* as coarse as the object, so that the subtraction is exact */
    return dvec3(step * rint(middle.x / step), step * rint(middle.y / step), step * rint(middle.z / step));
}

/* Makes one mesh of all of an object's runs of faces. */
static int add_mesh(struct reader *r, const struct object *object, struct kiln_dvec3 centre, uint32_t *mesh)
{
    const char *name = r->names_text + object->name;
    bool layout = true;
    int status = kiln_mesh_begin(r->builder, name, mesh, r->error);
    for (uint32_t i = object->first; status == KILN_OK && i != KILN_NONE; i = r->face_runs[i].next) {
        const struct face_run *face_run = &r->face_runs[i];
        const struct obj_material *material = &r->materials.list[face_run->material];
        if (face_run->triangle_count == 0)
            continue;
        layout &= face_run->texcoords && material->diffuse_map.path == 0 && material->emission_map.path == 0;
        status = add_part(r, name, *mesh, face_run, centre);
    }
    if (status != KILN_OK)
        return status;
    if (KILN_BUILDER_DATA(r->builder, struct kiln_mesh, KILN_SECTION_MESHES)[*mesh].triangle_count == 0) {
        r->builder->sections[KILN_SECTION_MESHES].count--;
        *mesh = KILN_NONE;
        return KILN_OK;
    }
    r->builder->mesh_has_lightmap_uv[*mesh] = layout;
    return KILN_OK;
}

/* Computes the transform from a mesh about its centre to the world: the file's unit and, if requested, its z axis
 * up. */
static void place_of(const struct kiln_builder *builder, struct kiln_dvec3 c, double place[12])
{
    const double unit = builder->unit > 0.0 ? builder->unit : 1.0;
    const double upright[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, z_up[9] = {1, 0, 0, 0, 0, 1, 0, -1, 0};
    const double *turn = builder->up_z ? z_up : upright;
    for (int row = 0; row < 3; row++) {
        for (int k = 0; k < 3; k++)
            place[4 * row + k] = unit * turn[3 * row + k];
        place[4 * row + 3] = unit * (turn[3 * row] * c.x + turn[3 * row + 1] * c.y + turn[3 * row + 2] * c.z);
    }
}

static int add_object(struct reader *r, const struct object *object)
{
    double place[12];
    const char *original = r->names_text + object->name;
    char name[KILN_NAME_LENGTH + 1];
    bool skipped = false;
    uint32_t mesh = KILN_NONE;
    const struct kiln_dvec3 centre = centre_of(r, object);
    place_of(r->builder, centre, place);
    int status = object->first == KILN_NONE ? KILN_OK : add_mesh(r, object, centre, &mesh);
    if (status != KILN_OK || mesh == KILN_NONE)
        return status;
    status = kiln_names_unique(&r->names, original, name, r->error);
    if (status == KILN_OK)
        status = kiln_object_add(r->builder, mesh, place, name, original, NULL, r->confine->scene, &skipped, r->error);
    r->without_area_objects += skipped;
    return status;
}

static int note_materials(struct reader *r)
{
    uint64_t undefined = 0;
    const char *first = "";
    for (size_t i = 1; i < r->materials.count; i++) {
        if (r->materials.list[i].defined)
            continue;
        first = undefined++ == 0 ? r->materials.text + r->materials.list[i].name : first;
    }
    if (undefined == 0)
        return KILN_OK;
    return kiln_builder_note(
        r->builder, 1, r->error,
        "%llu materials are defined in no material file and become diffuse grey, 0.6 (the first: '%.80s')",
        (unsigned long long)undefined, first);
}

/* Adds one note for each kind of oddity, with its count. */
static int write_notes(struct reader *r)
{
    const struct {
        uint64_t count;
        const char *text;
        uint32_t severity;
    } notes[] = {
        {r->assembly.without_area, "triangles without area were left out", KILN_NOTE_REPEATED},
        {r->assembly.replaced_normals,
         "corner normals were zero or pointed to the back of their triangle; the geometric normal replaces them",
         KILN_NOTE_WARNING},
        {r->lines, "points or lines were left out", KILN_NOTE_UNUSED},
        {r->without_area_objects, "objects are scaled to nothing and were left out", KILN_NOTE_REPEATED},
        {r->free_form, "statements of free-form curves and surfaces were left out; export them as polygons",
         KILN_NOTE_REPEATED},
        {r->materials.physical,
         "statements Pr, Pm or their maps say how rough and how much metal materials are: --materials auto and full "
         "take them so, --materials diffuse takes Kd alone",
         KILN_NOTE_INFORMATION},
        {r->materials.sheen, "statements of sheen (Ps, map_Ps) were left out", KILN_NOTE_INFORMATION},
        {r->materials.mended,
         "numbers of gloss (Ks, Ns, Ni, Pr, ...) or names of its maps were outside their range or unreadable; the "
         "nearest number or none replaces them",
         KILN_NOTE_WARNING}};
    int status = KILN_OK;
    for (size_t i = 0; i < sizeof notes / sizeof notes[0]; i++)
        if (notes[i].count > 0)
            KILN_TRY(kiln_builder_note(r->builder, notes[i].severity, r->error, "%llu %s",
                                       (unsigned long long)notes[i].count, notes[i].text));
    if (r->strange > 0)
        KILN_TRY(
            kiln_builder_note(r->builder, KILN_NOTE_UNUSED, r->error,
                              "%llu statements that kiln does not know were left out (the first: '%.40s' in line %llu)",
                              (unsigned long long)r->strange, r->strange_word, (unsigned long long)r->strange_line));
    KILN_TRY(note_materials(r));
end:
    return status;
}

static int add_all(struct reader *r)
{
    const struct kiln_environment none = {0};
    int status;
    KILN_TRY(obj_add_materials(&r->materials));
    for (size_t i = 0; i < r->object_count; i++)
        KILN_TRY(add_object(r, &r->objects[i]));
    KILN_TRY(write_notes(r));
end:
    return status != KILN_OK ? status
                             : kiln_builder_append(r->builder, KILN_SECTION_ENVIRONMENT, &none, 1, NULL, r->error);
}

static void release(struct reader *r)
{
    obj_materials_end(&r->materials);
    obj_polygon_destroy(&r->polygon);
    obj_symbols_destroy(&r->object_names);
    kiln_names_destroy(&r->names);
    kiln_free(&r->positions);
    kiln_free(&r->normals);
    kiln_free(&r->texcoords);
    kiln_free(&r->corners);
    kiln_arena_release(&r->arena);
}

int kiln_obj_read(struct kiln_confine *confine, struct kiln_builder *builder, struct kiln_error *error)
{
    struct reader r = {.confine = confine,
                       .builder = builder,
                       .error = error,
                       .object = KILN_NONE,
                       .materials = {.confine = confine,
                                     .builder = builder,
                                     .error = error,
                                     .images = {.confine = confine, .builder = builder}}};
    int status;
    KILN_TRY(obj_materials_begin(&r.materials));
    KILN_TRY(keep_name(&r, (struct obj_word){"", 0}, &r.group));
    KILN_TRY(read_text(&r));
    KILN_TRY(add_all(&r));
end:
    release(&r);
    return status;
}
