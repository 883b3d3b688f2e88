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
    obj_symbols_destroy(&m->told);
    kiln_images_destroy(&m->images);
}

/* ---- pictures ---- */

static const char no_need[] = "no bake needs it";

/* Names in OBJ and MTL files are not URIs. They are looked for in the folder of the material file, then in that of the
 * scene. */
static enum kiln_found find_picture(struct obj_materials *m, size_t folder, const struct obj_map *map,
                                    char path[PATH_LENGTH + 1])
{
    const char *name = m->text + map->path;
    const enum kiln_found beside = kiln_confine_find(m->confine, m->text + folder, name, path);
    if (m->text[folder] == '\0' || beside == KILN_FOUND_AS_NAMED)
        return beside;
    char other[PATH_LENGTH + 1];
    const enum kiln_found above = kiln_confine_find(m->confine, "", name, other);
    if (above == KILN_FOUND_NOT || (above == KILN_FOUND_OTHERWISE && beside == KILN_FOUND_OTHERWISE))
        return beside;
    (void)snprintf(path, PATH_LENGTH + 1, "%s", other);
    return above;
}

/* Looks for a map's picture. Adds a note, once per name and statement, if it is missing or found elsewhere. */
static int look_for(struct obj_materials *m, size_t folder, const struct obj_map *map, const char *what,
                    const char *material, bool matters, const char *instead)
{
    const char *name = m->text + map->path;
    char path[PATH_LENGTH + 1], key[2 * PATH_LENGTH + 64], place[160];
    const enum kiln_found way = find_picture(m, folder, map, path);
    const int length = snprintf(key, sizeof key, "%s\n%.1024s\n%.1024s", what, m->text + folder, name);
    const size_t told = m->told.used;
    uint32_t any = 0;
    if (way == KILN_FOUND_AS_NAMED)
        return KILN_OK;
    const int status = obj_symbol(&m->told, key, (size_t)length, &any, m->error);
    if (status != KILN_OK || m->told.used == told)
        return status;
    (void)snprintf(place, sizeof place, "material '%.80s': %.40s", material, what);
    if (way == KILN_FOUND_NOT)
        return kiln_missing_add(&m->missing, m->confine, m->builder, place, m->text + folder, name, matters, instead,
                                m->error);
    return kiln_builder_note(m->builder, KILN_NOTE_REPEATED, m->error,
                             "%s: '%.200s' is not in the scene's folder; '%.200s', which is, is used", place, name,
                             path);
}

/* ---- statements ---- */

struct library {
    struct obj_materials *materials;
    struct obj_text text;
    size_t folder;    /* offset into materials->text */
    uint32_t current; /* index of the current material; KILN_NONE before any newmtl */
    int status;       /* of the options of maps */
};

static bool same(struct obj_word word, const char *text)
{
    return word.length == strlen(text) && strncasecmp(word.text, text, word.length) == 0;
}

static int read_shares(struct library *l, enum kiln_number which, float *values, size_t most)
{
    const struct kiln_number_range *range = kiln_number_range(which);
    const char *keyword = range->key;
    double numbers[3];
    size_t count;
    const int status = obj_numbers(&l->text, keyword, numbers, 1, most, &count);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < most; i++) {
        const double value = numbers[i < count ? i : 0]; /* "Kd r" means "Kd r r r" */
        if (!kiln_number_fits(which, value)) {
            char what[100];
            (void)snprintf(what, sizeof what, "%s is %g, outside %g to %g", keyword, value, range->low, range->high);
            return obj_fail(&l->text, what, NULL);
        }
        values[i] = (float)value;
    }
    return KILN_OK;
}

static int read_diffuse(struct library *l, struct obj_material *m)
{
    return read_shares(l, KILN_NUMBER_MTL_DIFFUSE, m->diffuse, 3);
}
static int read_emission(struct library *l, struct obj_material *m)
{
    return read_shares(l, KILN_NUMBER_MTL_EMISSION, m->emission, 3);
}

static int read_alpha(struct library *l, struct obj_material *m)
{
    const struct obj_text before = l->text;
    struct obj_word word;
    if (!obj_next_word(&l->text, &word) || !obj_is(word, "-halo"))
        l->text = before;
    return read_shares(l, KILN_NUMBER_MTL_ALPHA, &m->alpha, 1);
}

static int read_transparency(struct library *l, struct obj_material *m)
{
    const int status = read_shares(l, KILN_NUMBER_MTL_TRANSPARENCY, &m->alpha, 1);
    m->alpha = 1.0f - m->alpha;
    return status;
}

/* Reads one to three numbers, of which two are used. The last word of the line is the file's name, even if it is a
 * number. */
static void read_pair(struct library *l, enum kiln_number which, float pair[2])
{
    const struct kiln_number_range *range = kiln_number_range(which);
    for (size_t i = 0; i < 3; i++) {
        const struct obj_text before = l->text;
        struct obj_word word;
        double value;
        if (!obj_next_word(&l->text, &word) || !obj_parse_number(word, &value) || !obj_more(&l->text)) {
            l->text = before;
            return;
        }
        if (!kiln_number_fits(which, value)) {
            char what[100];
            (void)snprintf(what, sizeof what, "%s is %g, outside %g to %g", range->key, value, range->low, range->high);
            l->status = obj_fail(&l->text, what, NULL);
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
        if (same(word, "-s"))
            read_pair(l, KILN_NUMBER_MTL_MAP_SCALE, map->scale);
        else
            read_pair(l, KILN_NUMBER_MTL_MAP_OFFSET, map->offset);
        map->moved = true;
        return true;
    }
    if (same(word, "-t")) {
        read_pair(l, KILN_NUMBER_MTL_MAP_OFFSET, turbulence);
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
    while (l->status == KILN_OK && read_option(l, map))
        ;
    return obj_rest(&l->text);
}

static int read_map(struct library *l, struct obj_map *map)
{
    const struct obj_word name = map_name(l, map);
    if (l->status != KILN_OK)
        return l->status;
    return name.length == 0 ? obj_fail(&l->text, "a map without the name of a file", NULL)
                            : keep_text(l->materials, name, &map->path);
}

static int read_diffuse_map(struct library *l, struct obj_material *m) { return read_map(l, &m->diffuse_map); }
static int read_emission_map(struct library *l, struct obj_material *m) { return read_map(l, &m->emission_map); }

/* Reads the name of an optional map. */
static int read_spare_map(struct library *l, struct obj_map *map)
{
    const struct obj_word name = map_name(l, map);
    if (l->status != KILN_OK)
        return l->status;
    return name.length == 0 ? KILN_OK : keep_text(l->materials, name, &map->path);
}

static int read_alpha_map(struct library *l, struct obj_material *m) { return read_spare_map(l, &m->alpha_map); }

/* Reads one to three numbers of gloss. A diffuse bake does not need them, so errors are tolerated and counted: numbers
 * out of range are clamped, and words ("spectral", "xyz") are left out. */
static int read_gloss_numbers(struct library *l, struct obj_material *m, float *values, size_t most,
                              enum kiln_number which)
{
    const struct kiln_number_range *range = kiln_number_range(which);
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
        m->gloss.mended += i < count && !kiln_number_fits(which, value);
        values[i] = (float)fmin(fmax(value, range->low), range->high);
    }
    return KILN_OK;
}

/* Reads a map of gloss. One without a name is left out and counted. */
static int read_gloss_map(struct library *l, struct obj_material *m, struct obj_map *map)
{
    const struct obj_word name = map_name(l, map);
    if (l->status != KILN_OK)
        return l->status;
    m->gloss.mended += name.length == 0;
    return name.length == 0 ? KILN_OK : keep_text(l->materials, name, &map->path);
}

static int read_specular(struct library *l, struct obj_material *m)
{
    return read_gloss_numbers(l, m, m->gloss.specular, 3, KILN_NUMBER_MTL_SPECULAR);
}

static int read_filter(struct library *l, struct obj_material *m)
{
    m->gloss.has_filter = true;
    return read_gloss_numbers(l, m, m->gloss.filter, 3, KILN_NUMBER_MTL_FILTER);
}

static int read_exponent(struct library *l, struct obj_material *m)
{
    m->gloss.has_exponent = true;
    return read_gloss_numbers(l, m, &m->gloss.exponent, 1, KILN_NUMBER_MTL_EXPONENT);
}

static int read_ior(struct library *l, struct obj_material *m)
{
    return read_gloss_numbers(l, m, &m->gloss.ior, 1, KILN_NUMBER_MTL_IOR);
}

static int read_illum(struct library *l, struct obj_material *m)
{
    return read_gloss_numbers(l, m, &m->gloss.illum, 1, KILN_NUMBER_MTL_ILLUM);
}

static int read_roughness(struct library *l, struct obj_material *m)
{
    m->gloss.physical = m->gloss.has_roughness = true;
    l->materials->physical++;
    return read_gloss_numbers(l, m, &m->gloss.roughness, 1, KILN_NUMBER_MTL_ROUGHNESS);
}

static int read_metallic(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    l->materials->physical++;
    return read_gloss_numbers(l, m, &m->gloss.metallic, 1, KILN_NUMBER_MTL_METALLIC);
}

static int read_clearcoat(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.clearcoat, 1, KILN_NUMBER_MTL_CLEARCOAT);
}

static int read_clearcoat_roughness(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.clearcoat_roughness, 1, KILN_NUMBER_MTL_CLEARCOAT_ROUGHNESS);
}

static int read_anisotropy(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.anisotropy, 1, KILN_NUMBER_MTL_ANISOTROPY);
}

static int read_anisotropy_rotation(struct library *l, struct obj_material *m)
{
    m->gloss.physical = true;
    return read_gloss_numbers(l, m, &m->gloss.rotation, 1, KILN_NUMBER_MTL_ANISOTROPY_ROTATION);
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

/* Whether a statement names a picture that kiln does not use: bump, normal, displacement, reflection, ... */
static bool names_a_picture(struct obj_word keyword)
{
    static const char *const others[] = {"bump", "norm", "disp", "decal", "refl"};
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++)
        if (same(keyword, others[i]))
            return true;
    return keyword.length > 4 && strncasecmp(keyword.text, "map_", 4) == 0;
}

/* Counts an unused statement. If it names a picture, the picture is looked for. */
static int read_other(struct library *l, struct obj_word keyword)
{
    struct obj_materials *m = l->materials;
    struct obj_map map = {.path = 0};
    char what[48];
    (void)snprintf(what, sizeof what, "%.*s", keyword.length < 40 ? (int)keyword.length : 40, keyword.text);
    kiln_kinds_add(&m->unused, 1, "%s", what);
    if (!names_a_picture(keyword))
        return KILN_OK;
    const int status = read_spare_map(l, &map);
    if (status != KILN_OK || map.path == 0)
        return status;
    return look_for(m, l->folder, &map, what, l->current == KILN_NONE ? "" : m->text + m->list[l->current].name, false,
                    no_need);
}

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
    return read_other(l, keyword);
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
    char path[PATH_LENGTH + 1], found[PATH_LENGTH + 1], place[160];
    (void)snprintf(place, sizeof place, "mtllib '%.*s'", name.length < 100 ? (int)name.length : 100, name.text);
    if (!plain_path(name, "", path))
        return kiln_fail(error, KILN_BAD_INPUT, "%.512s: %s is empty or longer than %d bytes; name a file",
                         m->confine->scene, place, PATH_LENGTH);
    const enum kiln_found way = kiln_confine_find(m->confine, "", path, found);
    int status = kiln_confine_map(m->confine, m->builder, way == KILN_FOUND_NOT ? path : found, place, &file, error);
    if (status != KILN_OK)
        return status;
    if (way == KILN_FOUND_OTHERWISE) {
        status = kiln_builder_note(m->builder, KILN_NOTE_REPEATED, error,
                                   "%s is not in the scene's folder; '%.200s', which is, is used", place, found);
        (void)snprintf(path, sizeof path, "%.1024s", found);
    }
    const char *slash = strrchr(path, '/');
    KILN_TRY(status);
    KILN_TRY(keep_text(m, (struct obj_word){path, slash == NULL ? 0 : (size_t)(slash + 1 - path)}, &l.folder));
    KILN_TRY(obj_text_open(&l.text, &file, m->confine->scene, place, m->error));
    KILN_TRY(read_statements(&l));
end:
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
    char path[PATH_LENGTH + 1];
    if (find_picture(m, material->folder, map, path) == KILN_FOUND_NOT)
        (void)snprintf(path, sizeof path, "%.1024s", m->text + map->path); /* the sentence says so */
    return kiln_confine_map(m->confine, m->builder, path, what, file, m->error);
}

bool obj_map_opens(struct obj_materials *m, const struct obj_material *material, const struct obj_map *map)
{
    struct kiln_error *told = m->error;
    struct kiln_file file;
    char path[PATH_LENGTH + 1];
    if (find_picture(m, material->folder, map, path) == KILN_FOUND_NOT)
        return true;
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
                     const char *what, const char *instead, uint32_t *index)
{
    char key[2 * PATH_LENGTH + 8], path[PATH_LENGTH + 1];
    if (map->path == 0)
        return KILN_OK;
    int status = look_for(m, material->folder, map, what, m->text + material->name, true, instead);
    if (status != KILN_OK || find_picture(m, material->folder, map, path) == KILN_FOUND_NOT) {
        *index = KILN_NONE;
        return status;
    }
    const int length = snprintf(key, sizeof key, "%c%.1024s\n%.1024s", (map->clamp ? "cC" : "rR")[srgb ? 0 : 1],
                                m->text + material->folder, m->text + map->path);
    const uint32_t fresh = (uint32_t)m->builder->sections[KILN_SECTION_TEXTURES].count;
    *index = fresh;
    status = obj_symbol(&m->textures, key, (size_t)length, index, m->error);
    if (status == KILN_OK && *index == fresh)
        status = make_texture(m, material, map, srgb, what, index);
    return status;
}

/* Corrects a black Kd of a material with map_Kd, which it would multiply. Exporters that write both mean the picture
 * alone. */
static int whiten(struct obj_materials *m, const struct obj_material *source, struct kiln_material *material)
{
    if (source->diffuse_map.path == 0 || source->diffuse[0] + source->diffuse[1] + source->diffuse[2] > 0.0f)
        return KILN_OK;
    material->base_color[0] = material->base_color[1] = material->base_color[2] = 1.0f;
    return kiln_builder_note(m->builder, KILN_NOTE_REPEATED, m->error,
                             "material '%.80s': its Kd is black, which would make its map_Kd black; the map is used as "
                             "it is, as with Kd 1",
                             m->text + source->name);
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
    int status = whiten(m, source, &material);
    if (status == KILN_OK)
        status = obj_find_texture(m, source, &source->diffuse_map, true, "map_Kd", "white stands in for it",
                                  &material.base_color_texture);
    if (status == KILN_OK)
        status = obj_find_texture(m, source, &source->emission_map, true, "map_Ke", "what it would light is dark",
                                  &material.emission_texture);
    const float most = source->emission[0] + source->emission[1] + source->emission[2];
    for (int c = 0; c < 3 && source->emission_map.path != 0; c++)
        material.emission[c] = material.emission_texture == KILN_NONE ? 0.0f
                               : most == 0.0f                         ? 1.0f
                                                                      : material.emission[c];
    if (status == KILN_OK && source->alpha_map.path != 0)
        status = look_for(m, source->folder, &source->alpha_map, "map_d", name, false, no_need);
    if (status == KILN_OK && source->alpha_map.path != 0)
        status = kiln_builder_note(m->builder, KILN_NOTE_REPEATED, m->error,
                                   "material '%.80s': its opacity map is left out", name);
    if (status == KILN_OK && source->alpha == 0.0f)
        status = kiln_builder_note(m->builder, KILN_NOTE_REPEATED, m->error,
                                   "material '%.80s': it lets all light through (d 0, or Tr 1): if it is meant to be "
                                   "opaque, write d 1",
                                   name);
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
    for (size_t i = 0; i < m->count; i++)
        KILN_TRY(add_to_builder(m, &m->list[i]));
    KILN_TRY(kiln_kinds_note(&m->unused, m->builder, KILN_NOTE_UNUSED,
                             "statements in material files, but not in a bake", m->error));
    KILN_TRY(kiln_missing_end(&m->missing, m->confine, m->builder, m->error));
end:
    return status;
}
