#include "coordinator/view/show.h"

#include <stdio.h>
#include <string.h>

static const char group_prefix[] = "group:";

/* Layers of kiln.h5 other than fields of a bake. */
static const struct kiln_field points[] = {
    {.name = "position",
     .unit = "m",
     .meaning = KILN_FIELD_PLACE,
     .components = 3,
     .dataset = "/points/position",
     .description = "world position of the surface points"},
    {.name = "normal",
     .unit = "1",
     .meaning = KILN_FIELD_DIRECTION,
     .components = 3,
     .dataset = "/points/normal",
     .description = "shading normal of the surface points, world"},
};

/* Layers that are computed from a bake for a picture. */
static const struct made {
    enum kiln_show_kind kind;
    struct kiln_field field;
} made[] = {
    {KILN_SHOW_VOXELS,
     {.name = "voxels",
      .unit = "1",
      .meaning = KILN_FIELD_COLOR,
      .components = 3,
      .dataset = "/points/position",
      .description = "filled cells of the grid of --visibility voxels"}},
    {KILN_SHOW_VOXEL,
     {.name = "voxel",
      .unit = "1",
      .meaning = KILN_FIELD_COLOR,
      .components = 3,
      .dataset = "/points/position",
      .description = "cells of the grid of --visibility voxels that surfaces lie in"}},
    {KILN_SHOW_SEEN,
     {.name = "seen",
      .unit = "1",
      .meaning = KILN_FIELD_COLOR,
      .components = 3,
      .dataset = "/points/position",
      .description =
          "surface points that a texel sees: white; hidden ones: blue; those turned away: dark; the texel: orange"}},
    {KILN_SHOW_LINKS,
     {.name = "links",
      .unit = "%",
      .meaning = KILN_FIELD_SCALE,
      .components = 1,
      .dataset = "/points/area",
      .description = "view factors of the nodes that a texel gathers from; -1: the texel itself"}},
};

/* Sentences of --help; other fields use their descriptions. `meaning`: of a field; 0: its own. */
static const struct shown {
    const char *name, *unit, *sentence;
    enum kiln_field_meaning meaning;
} shows[] = {
    {"light", "", "the radiance that the surfaces send to the eye; as the atlas, the irradiance that falls on them", 0},
    {"texels", "1", "a checkerboard, a square for each texel, in a hue for each object", 0},
    {"direct", "", "irradiance straight from lights", 0},
    {"indirect", "", "irradiance from other surfaces", 0},
    {"total", "", "all irradiance", 0},
    {"error", "", "standard error of the luminance of all irradiance, as the bake states it", KILN_FIELD_SCALE},
    {"error_direct", "", "the same of direct light, of a bake that is denoised or has --error-map", KILN_FIELD_SCALE},
    {"error_indirect", "", "the same of light from other surfaces", KILN_FIELD_SCALE},
    {"error_caustic", "", "the same of caustics", KILN_FIELD_SCALE},
    {"position", "m", "where a texel's surface point lies in the world: x, y, z as red, green, blue", 0},
    {"normal", "1", "its shading normal, -1 to 1 along x, y, z as red, green, blue", 0},
    {"albedo", "1", "its diffuse colour, 0 to 1", KILN_FIELD_COLOR},
    {"area", "m2", "how much surface lies in the texel", KILN_FIELD_SCALE},
    {"node", "texel", "texels a side of the node that it was in when --method radiosity last gathered (--keep-nodes)",
     KILN_FIELD_SCALE},
    {"voxels", "1", "the filled cells of the grid of --visibility voxels, as boxes (--voxels)", 0},
    {"voxel", "1", "on the surfaces, the cells of that grid that they lie in", 0},
    {"seen", "1", "which surface points a texel sees, by rays or by the grid of --voxels N (--texel)", 0},
    {"links", "%", "the nodes that a texel gathers from by --patches links, and how much of its view each is (--texel)",
     0},
    {"group:NAME", "", "irradiance from one group of lights (--light-groups)", 0},
};
enum {
    SHOWS = sizeof shows / sizeof *shows,
    POINTS = sizeof points / sizeof *points,
    MADE = sizeof made / sizeof *made
};

static const struct shown *find_shown(const char *name)
{
    for (size_t i = 0; i < SHOWS; i++)
        if (strcmp(shows[i].name, name) == 0)
            return &shows[i];
    return NULL;
}

/* Whether a row of the table of fields can be shown: three components at most, or layers of lightmaps. */
static bool is_showable(const struct kiln_field *field)
{
    return field->dataset != NULL && (field->channels != NULL || field->components == 1 || field->components == 3);
}

static const struct kiln_field *find_field(const char *name)
{
    size_t rows;
    const struct kiln_field *table = kiln_fields(&rows);
    for (size_t i = 0; i < POINTS; i++)
        if (strcmp(points[i].name, name) == 0)
            return &points[i];
    for (size_t i = 0; i < rows; i++)
        if (is_showable(&table[i]) && strcmp(kiln_field_shown_name(&table[i]), name) == 0)
            return &table[i];
    return NULL;
}

static void take_group(struct kiln_show *show, const char *name)
{
    static const char colors[] = "RGB";
    (void)snprintf(show->dataset, sizeof show->dataset, "/groups/%s", name);
    for (int c = 0; c < 3; c++) {
        (void)snprintf(show->channel[c], sizeof show->channel[c], "group.%s.%c", name, colors[c]);
        show->channels[c] = show->channel[c];
    }
    show->field = (struct kiln_field){.name = "group",
                                      .components = 3,
                                      .dataset = show->dataset,
                                      .channels = show->channels,
                                      .description = "irradiance from one group of lights"};
}

bool kiln_show_row(size_t i, const char **name, const char **unit, const char **sentence)
{
    size_t rows, extra = SHOWS;
    const struct kiln_field *table = kiln_fields(&rows);
    if (i < SHOWS) {
        *name = shows[i].name;
        *unit = shows[i].unit;
        *sentence = shows[i].sentence;
        return true;
    }
    for (size_t f = 0; f < rows; f++) {
        if (!is_showable(&table[f]) || find_shown(kiln_field_shown_name(&table[f])) != NULL || extra++ < i)
            continue;
        *name = kiln_field_shown_name(&table[f]);
        *unit = table[f].unit != NULL ? table[f].unit : "";
        *sentence = table[f].description;
        return true;
    }
    return false;
}

static int refuse(const char *name, struct kiln_error *error)
{
    char list[512] = "";
    const char *row, *unit, *sentence;
    for (size_t i = 0; kiln_show_row(i, &row, &unit, &sentence); i++) {
        const size_t used = strlen(list);
        (void)snprintf(list + used, sizeof list - used, "%s%s", i > 0 ? ", " : "", row);
    }
    return kiln_fail(error, KILN_USAGE, "--show %.100s: there is nothing of that name to show; there is: %s", name,
                     list);
}

int kiln_show_find(struct kiln_show *show, const char *name, struct kiln_error *error)
{
    const size_t prefix = sizeof group_prefix - 1;
    const char *group = strncmp(name, group_prefix, prefix) == 0 ? name + prefix : NULL;
    *show = (struct kiln_show){.texels = strcmp(name, "texels") == 0};
    if (show->texels || strcmp(name, "light") == 0)
        return KILN_OK;
    if (group != NULL && group[0] != '\0' && strlen(group) < KILN_GROUP_NAME && strchr(group, '/') == NULL) {
        take_group(show, group);
        return KILN_OK;
    }
    for (size_t i = 0; i < MADE; i++)
        if (strcmp(made[i].field.name, name) == 0) {
            show->kind = made[i].kind;
            show->squares = show->kind == KILN_SHOW_SEEN || show->kind == KILN_SHOW_LINKS;
            show->field = made[i].field;
            return KILN_OK;
        }
    const struct kiln_field *field = find_field(name);
    if (field == NULL)
        return refuse(name, error);
    show->field = *field;
    const struct shown *shown = find_shown(name);
    show->squares = strcmp(name, "node") == 0;
    if (shown != NULL && shown->meaning != KILN_FIELD_AMOUNT)
        show->field.meaning = shown->meaning;
    return KILN_OK;
}
