/* The MTL reader: materials of an OBJ file. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "coordinator/import/obj_document.h"
#include "worker/base/memory.h"

enum { PATH_LENGTH = 1024 };

static const char no_name[] = "DefaultMaterial"; /* for faces without a material and newmtl without a name */

/* ---- strings and names ---- */

static int keep_text(struct obj_materials *m, struct obj_word word, size_t *offset)
{
    const int status = kiln_grow(&m->text, &m->text_capacity, m->text_size + word.length + 1, 1, "names", m->error);
    if (status != KILN_OK)
        return status;
    memcpy(m->text + m->text_size, word.text, word.length);
    m->text[m->text_size + word.length] = '\0';
    *offset = m->text_size;
    m->text_size += word.length + 1;
    return KILN_OK;
}

static int add_material(struct obj_materials *m, struct obj_word name)
{
    int status = kiln_grow(&m->list, &m->capacity, m->count + 1, sizeof *m->list, "materials", m->error);
    if (status != KILN_OK)
        return status;
    struct obj_material *material = &m->list[m->count];
    *material = (struct obj_material){.diffuse = {0.6f, 0.6f, 0.6f}, .alpha = 1.0f};
    obj_gloss_begin(&material->gloss);
    status = keep_text(m, name, &material->name);
    m->count += status == KILN_OK;
    return status;
}

int obj_find_material(struct obj_materials *m, struct obj_word name, uint32_t *index)
{
    if (name.length == 0)
        name = (struct obj_word){no_name, strlen(no_name)};
    *index = (uint32_t)m->count;
    if (m->count >= KILN_NONE)
        return kiln_fail(m->error, KILN_BAD_INPUT, "%.512s: it has more than 2^32 - 2 materials; split it",
                         m->confine->scene);
    const int status = obj_symbol(&m->names, name.text, name.length, index, m->error);
    return status != KILN_OK || *index < m->count ? status : add_material(m, name);
}

int obj_materials_begin(struct obj_materials *m)
{
    size_t empty;
    uint32_t first;
    const int status = keep_text(m, (struct obj_word){"", 0}, &empty);
    return status != KILN_OK ? status : obj_find_material(m, (struct obj_word){"", 0}, &first);
}

void obj_materials_end(struct obj_materials *m)
{
    kiln_free(&m->list);
    kiln_free(&m->text);
    obj_symbols_destroy(&m->names);
    obj_symbols_destroy(&m->textures);
    kiln_images_destroy(&m->images);
}

/* ---- statements ---- */

struct library {
    struct obj_materials *materials;
    struct obj_text text;
    size_t folder;    /* offset into materials->text */
    uint32_t current; /* index of the current material; KILN_NONE before any newmtl */
};

static bool same(struct obj_word word, const char *text)
{
    return word.length == strlen(text) && strncasecmp(word.text, text, word.length) == 0;
}

static int read_shares(struct library *l, const char *keyword, float *values, size_t most, double high)
{
    double numbers[3];
    size_t count;
    const int status = obj_numbers(&l->text, keyword, numbers, 1, most, &count);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < most; i++) {
        const double value = numbers[i < count ? i : 0]; /* "Kd r" means "Kd r r r" */
        if (!(value >= 0.0 && value <= high)) {
            char what[100];
            (void)snprintf(what, sizeof what, "%s is %g, outside 0 to %g", keyword, value, high);
            return obj_fail(&l->text, what, NULL);
        }
        values[i] = (float)value;
    }
    return KILN_OK;
}

static int read_diffuse(struct library *l, struct obj_material *m) { return read_shares(l, "Kd", m->diffuse, 3, 1.0); }
static int read_emission(struct library *l, struct obj_material *m)
{
    return read_shares(l, "Ke", m->emission, 3, 1e30);
}

static int read_alpha(struct library *l, struct obj_material *m)
{
    const struct obj_text before = l->text;
    struct obj_word word;
    if (!obj_next_word(&l->text, &word) || !obj_is(word, "-halo"))
        l->text = before;
    return read_shares(l, "d", &m->alpha, 1, 1.0);
}

static int read_transparency(struct library *l, struct obj_material *m)
{
    const int status = read_shares(l, "Tr", &m->alpha, 1, 1.0);
    m->alpha = 1.0f - m->alpha;
    return status;
}

/* Reads one to three numbers, of which two are used. The last word of the line is the file's name, even if it is a
 * number. */
static void read_pair(struct library *l, float pair[2])
{
    for (size_t i = 0; i < 3; i++) {
        const struct obj_text before = l->text;
        struct obj_word word;
        double value;
        if (!obj_next_word(&l->text, &word) || !obj_parse_number(word, &value) || !obj_more(&l->text)) {
            l->text = before;
            return;
        }
        if (i < 2)
            pair[i] = (float)value;
    }
}

/* Reads one option of a map; false if the next word is not an option. */
static bool read_option(struct library *l, struct obj_map *map)
{
    static const struct {
        const char *name;
        unsigned arguments;
    } others[] = {{"-blendu", 1}, {"-blendv", 1},  {"-cc", 1},   {"-texres", 1}, {"-bm", 1},
                  {"-boost", 1},  {"-imfchan", 1}, {"-type", 1}, {"-mm", 2}};
    const struct obj_text before = l->text;
    struct obj_word word;
    float turbulence[2];
    if (!obj_next_word(&l->text, &word))
        return false;
    if (same(word, "-s") || same(word, "-o")) {
        read_pair(l, same(word, "-s") ? map->scale : map->offset);
        map->moved = true;
        return true;
    }
    if (same(word, "-t")) {
        read_pair(l, turbulence);
        return true;
    }
    if (same(word, "-clamp")) {
        map->clamp = obj_next_word(&l->text, &word) && same(word, "on");
        return true;
    }
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        if (!same(word, others[i].name))
            continue;
        for (unsigned k = 0; k < others[i].arguments; k++)
            (void)obj_next_word(&l->text, &word);
        return true;
    }
    l->text = before;
    return false;
}

/* Reads a map's options, and gives the name of its file. */
static struct obj_word map_name(struct library *l, struct obj_map *map)
{
    *map = (struct obj_map){.scale = {1.0f, 1.0f}};
    while (read_option(l, map))
        ;
    return obj_rest(&l->text);
}

static int read_map(struct library *l, struct obj_map *map)
{
    const struct obj_word name = map_name(l, map);
    return name.length == 0 ? obj_fail(&l->text, "a map without the name of a file", NULL)
                            : keep_text(l->materials, name, &map->path);
}

static int read_diffuse_map(struct library *l, struct obj_material *m) { return read_map(l, &m->diffuse_map); }
static int read_emission_map(struct library *l, struct obj_material *m) { return read_map(l, &m->emission_map); }

static int read_alpha_map(struct library *l, struct obj_material *m)
{
    (void)l;
    m->alpha_map = true;
    return KILN_OK;
}

/* Reads one to three numbers of gloss. A diffuse bake does without them, so that numbers outside 0 to `high` become the
 * nearest one inside, and what is no number ("spectral", "xyz") is left out; both are counted. */
static int read_gloss_numbers(struct library *l, struct obj_material *m, float *values, size_t most, double high)
{
    double numbers[3];
    size_t count = 0;
    struct obj_word word;
    while (count < most && obj_next_word(&l->text, &word) && obj_parse_number(word, &numbers[count]))
        count++;
    if (count == 0) {
        m->gloss.mended++;
        return KILN_OK;
    }
    for (size_t i = 0; i < most; i++) {
        const double value = numbers[i < count ? i : 0];
        m->gloss.mended += i < count && !(value >= 0.0 && value <= high);
        values[i] = (float)fmin(fmax(value, 0.0), high);
    }
    return KILN_OK;
}

/* The same for a map: one without a name is left out and counted. */
static int read_gloss_map(struct library *l, struct obj_material *m, struct obj_map *map)
{
    const struct obj_word name = map_name(l, map);
    m->gloss.mended += name.length == 0;
    return name.length == 0 ? KILN_OK : keep_text(l->materials, name, &map->path);
}

static int read_specular(struct library *l, struct obj_material *m)
{
    return read_gloss_numbers(l, m, m->gloss.specular, 3, 1.0);
}

static int read_filter(struct library *l, struct obj_material *m)
{
    m->gloss.has_filter = true;
    return read_gloss_numbers(l, m, m->gloss.filter, 3, 1.0);
}

static int read_exponent(struct library *l, struct obj_material *m)
{
    m->gloss.has_exponent = true;
    return read_gloss_numbers(l, m, &m->gloss.exponent, 1, 1e6);
}

static int read_ior(struct library *l, struct obj_material *m)
{
    return read_gloss_numbers(l, m, &m->gloss.ior, 1, 1e6);
}

static int read_illum(struct library *l, struct obj_material *m)
{
    return read_gloss_numbers(l, m, &m->gloss.illum, 1, 10.0);
}

static int read_roughness(struct library *l, struct obj_material *m)
{
    m->gloss.physical = m->gloss.has_roughness = true;
    l->materials->physical++;
    return read_gloss_numbers(l, m, &m->gloss.roughness, 1, 1.0);
}

static int read_metallic(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    l->materials->physical++;
    return read_gloss_numbers(l, m, &m->gloss.metallic, 1, 1.0);
}

static int read_clearcoat(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.clearcoat, 1, 1.0);
}

static int read_clearcoat_roughness(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.clearcoat_roughness, 1, 1.0);
}

static int read_anisotropy(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.anisotropy, 1, 1.0);
}

static int read_anisotropy_rotation(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.rotation, 1, 1.0);
}

static int read_specular_map(struct library *l, struct obj_material *m)
{
    return read_gloss_map(l, m, &m->gloss.specular_map);
}

static int read_exponent_map(struct library *l, struct obj_material *m)
{
    return read_gloss_map(l, m, &m->gloss.exponent_map);
}

static int read_roughness_map(struct library *l, struct obj_material *m)
{
    m->gloss.physical = m->gloss.has_roughness = true;
    l->materials->physical++;
    return read_gloss_map(l, m, &m->gloss.roughness_map);
}

static int read_metallic_map(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    l->materials->physical++;
    return read_gloss_map(l, m, &m->gloss.metallic_map);
}

static int read_sheen(struct library *l, struct obj_material *m)
{
    (void)m;
    l->materials->sheen++;
    return KILN_OK;
}

/* The statements that kiln reads: those that affect diffuse light, then those of gloss. All others are left out, and
 * those of gloss too before any newmtl. */
static const struct {
    const char *keyword;
    int (*read)(struct library *l, struct obj_material *m);
    bool gloss;
} statements[] = {{"Kd", read_diffuse, false},
                  {"Ke", read_emission, false},
                  {"d", read_alpha, false},
                  {"Tr", read_transparency, false},
                  {"map_Kd", read_diffuse_map, false},
                  {"map_Ke", read_emission_map, false},
                  {"map_emissive", read_emission_map, false},
                  {"map_d", read_alpha_map, false},
                  {"map_opacity", read_alpha_map, false},
                  {"Ks", read_specular, true},
                  {"Tf", read_filter, true},
                  {"Ns", read_exponent, true},
                  {"Ni", read_ior, true},
                  {"illum", read_illum, true},
                  {"map_Ks", read_specular_map, true},
                  {"map_Ns", read_exponent_map, true},
                  {"Pr", read_roughness, true},
                  {"Pm", read_metallic, true},
                  {"map_Pr", read_roughness_map, true},
                  {"map_Pm", read_metallic_map, true},
                  {"Pc", read_clearcoat, true},
                  {"Pcr", read_clearcoat_roughness, true},
                  {"aniso", read_anisotropy, true},
                  {"anisor", read_anisotropy_rotation, true},
                  {"Ps", read_sheen, true},
                  {"map_Ps", read_sheen, true}};

static int read_statement(struct library *l, struct obj_word keyword)
{
    for (size_t i = 0; i < sizeof statements / sizeof statements[0]; i++) {
        if (!same(keyword, statements[i].keyword))
            continue;
        if (l->current == KILN_NONE && statements[i].gloss)
            return KILN_OK;
        if (l->current == KILN_NONE)
            return obj_fail(&l->text, "a statement before any newmtl:", &keyword);
        return statements[i].read(l, &l->materials->list[l->current]);
    }
    return KILN_OK;
}

static int read_statements(struct library *l)
{
    struct obj_word keyword;
    int status = KILN_OK;
    while (status == KILN_OK && obj_next_line(&l->text, &keyword)) {
        if (!same(keyword, "newmtl")) {
            status = read_statement(l, keyword);
            continue;
        }
        status = obj_find_material(l->materials, obj_rest(&l->text), &l->current);
        if (status == KILN_OK) {
            l->materials->list[l->current].defined = true;
            l->materials->list[l->current].folder = l->folder;
        }
    }
    return status;
}

/* ---- files ---- */

/* Converts a name to a path. Names in OBJ and MTL files are not URIs: they are used as they are, with backslashes as
 * separators. False: empty or too long. */
static bool plain_path(struct obj_word name, const char *folder, char path[PATH_LENGTH + 1])
{
    while (name.length > 1 && name.text[0] == '.' && (name.text[1] == '/' || name.text[1] == '\\')) {
        name.text += 2;
        name.length -= 2;
    }
    const size_t begin = strlen(folder);
    if (name.length == 0 || begin + name.length > PATH_LENGTH)
        return false;
    memcpy(path, folder, begin);
    for (size_t i = 0; i < name.length; i++)
        path[begin + i] = name.text[i] == '\\' ? '/' : name.text[i];
    path[begin + name.length] = '\0';
    return true;
}

static int read_library(struct obj_materials *m, struct obj_word name, struct kiln_error *error)
{
    struct library l = {.materials = m, .current = KILN_NONE};
    struct kiln_file file;
    char path[PATH_LENGTH + 1], place[160];
    (void)snprintf(place, sizeof place, "mtllib '%.*s'", name.length < 100 ? (int)name.length : 100, name.text);
    if (!plain_path(name, "", path))
        return kiln_fail(error, KILN_BAD_INPUT, "%.512s: %s is empty or longer than %d bytes; name a file",
                         m->confine->scene, place, PATH_LENGTH);
    int status = kiln_confine_map(m->confine, m->builder, path, place, &file, error);
    if (status != KILN_OK)
        return status;
    const char *slash = strrchr(path, '/');
    status = keep_text(m, (struct obj_word){path, slash == NULL ? 0 : (size_t)(slash + 1 - path)}, &l.folder);
    if (status == KILN_OK)
        status = obj_text_open(&l.text, &file, m->confine->scene, place, m->error);
    if (status == KILN_OK)
        status = read_statements(&l);
    obj_text_close(&l.text);
    kiln_file_unmap(&file);
    return status;
}

/* Whether such a file exists; its faults are reported when it is read. */
static bool file_exists(const struct obj_materials *m, struct obj_word name)
{
    struct kiln_file file;
    char path[PATH_LENGTH + 1];
    const bool there =
        plain_path(name, "", path) && kiln_confine_map(m->confine, NULL, path, "mtllib", &file, NULL) == KILN_OK;
    if (there)
        kiln_file_unmap(&file);
    return there;
}

int obj_read_libraries(struct obj_materials *m, struct obj_word names)
{
    const bool several =
        memchr(names.text, ' ', names.length) != NULL || memchr(names.text, '\t', names.length) != NULL;
    if (!several || file_exists(m, names))
        return read_library(m, names, m->error);
    const struct kiln_file line = {(const unsigned char *)names.text, names.length};
    struct obj_text text = {.at = line.data, .end = line.data + line.size, .line = 1, .name = ""};
    struct obj_word name;
    int status = KILN_OK;
    while (status == KILN_OK && obj_next_word(&text, &name))
        status = read_library(m, name, m->error);
    return status;
}

/* ---- into the builder ---- */

static int map_picture(struct obj_materials *m, const struct obj_material *material, const struct obj_map *map,
                       const char *what, struct kiln_file *file)
{
    const char *name = m->text + map->path, *folder = m->text + material->folder;
    const struct obj_word word = {name, strlen(name)};
    char path[PATH_LENGTH + 1];
    if (folder[0] != '\0' && plain_path(word, folder, path) &&
        kiln_confine_map(m->confine, m->builder, path, what, file, NULL) == KILN_OK)
        return KILN_OK;
    if (!plain_path(word, "", path))
        return kiln_fail(m->error, KILN_BAD_INPUT, "%.512s: %s is empty or longer than %d bytes; name a file",
                         m->confine->scene, what, PATH_LENGTH);
    return kiln_confine_map(m->confine, m->builder, path, what, file, m->error);
}

bool obj_map_opens(struct obj_materials *m, const struct obj_material *material, const struct obj_map *map)
{
    struct kiln_error *told = m->error;
    struct kiln_file file;
    m->error = NULL;
    const bool opens = map_picture(m, material, map, "", &file) == KILN_OK;
    m->error = told;
    if (opens)
        kiln_file_unmap(&file);
    return opens;
}

static int make_texture(struct obj_materials *m, const struct obj_material *material, const struct obj_map *map,
                        bool srgb, const char *what, uint32_t *index)
{
    struct kiln_texture texture = {.srgb = srgb,
                                   .wrap_u = map->clamp ? KILN_WRAP_CLAMP : KILN_WRAP_REPEAT,
                                   .wrap_v = map->clamp ? KILN_WRAP_CLAMP : KILN_WRAP_REPEAT};
    struct kiln_image image = {0};
    struct kiln_file file;
    char where[640];
    size_t at = 0;
    (void)snprintf(where, sizeof where, "%.512s: %s", m->confine->scene, what);
    int status = map_picture(m, material, map, what, &file);
    if (status != KILN_OK)
        return status;
    const struct kiln_image_bytes bytes = {.data = file.data, .size = file.size, .any_format = true, .where = where};
    status = kiln_image_append(&m->images, &bytes, &image, m->error);
    kiln_file_unmap(&file);
    texture.first = image.first;
    texture.width = image.width;
    texture.height = image.height;
    if (status == KILN_OK)
        status = kiln_builder_append(m->builder, KILN_SECTION_TEXTURES, &texture, 1, &at, m->error);
    *index = (uint32_t)at;
    return status;
}

int obj_find_texture(struct obj_materials *m, const struct obj_material *material, const struct obj_map *map, bool srgb,
                     const char *what, uint32_t *index)
{
    char key[2 * PATH_LENGTH + 8];
    if (map->path == 0)
        return KILN_OK;
    const int length = snprintf(key, sizeof key, "%c%.1024s\n%.1024s", (map->clamp ? "cC" : "rR")[srgb ? 0 : 1],
                                m->text + material->folder, m->text + map->path);
    const uint32_t fresh = (uint32_t)m->builder->sections[KILN_SECTION_TEXTURES].count;
    *index = fresh;
    int status = obj_symbol(&m->textures, key, (size_t)length, index, m->error);
    if (status == KILN_OK && *index == fresh)
        status = make_texture(m, material, map, srgb, what, index);
    return status;
}

static int add_to_builder(struct obj_materials *m, struct obj_material *source)
{
    const char *name = m->text + source->name;
    struct kiln_material material = {.base_color_texture = KILN_NONE,
                                     .emission_texture = KILN_NONE,
                                     .transmission_texture = KILN_NONE,
                                     .alpha_cutoff = 0.5f,
                                     .roughness = 1.0f};
    memcpy(material.base_color, source->diffuse, sizeof source->diffuse);
    material.base_color[3] = source->alpha;
    material.alpha_mode = source->alpha < 1.0f ? KILN_ALPHA_BLEND : KILN_ALPHA_OPAQUE;
    memcpy(material.emission, source->emission, sizeof source->emission);
    int status = obj_find_texture(m, source, &source->diffuse_map, true, "map_Kd", &material.base_color_texture);
    if (status == KILN_OK)
        status = obj_find_texture(m, source, &source->emission_map, true, "map_Ke", &material.emission_texture);
    if (material.emission_texture != KILN_NONE &&
        material.emission[0] + material.emission[1] + material.emission[2] == 0.0f)
        material.emission[0] = material.emission[1] = material.emission[2] = 1.0f;
    if (status == KILN_OK && source->alpha_map)
        status = kiln_builder_note(m->builder, 1, m->error, "material '%.80s': its opacity map is left out", name);
    if (status == KILN_OK)
        status = kiln_builder_string(m->builder, name, strlen(name), &material.name, m->error);
    size_t at = 0;
    if (status == KILN_OK)
        status = kiln_builder_append(m->builder, KILN_SECTION_MATERIALS, &material, 1, &at, m->error);
    return status == KILN_OK ? obj_add_gloss(m, source, (uint32_t)at) : status;
}

int obj_add_materials(struct obj_materials *m)
{
    int status = KILN_OK;
    for (size_t i = 0; i < m->count && status == KILN_OK; i++)
        status = add_to_builder(m, &m->list[i]);
    return status;
}
