/* kiln info: shows what the importer reads from a scene. */
#include <stdio.h>
#include <string.h>

#include "coordinator/cli/commands.h"
#include "coordinator/cli/devices.h"
#include "coordinator/files/json.h"
#include "coordinator/bake/prepare/scene_survey.h"
#include "coordinator/run/progress.h"
#include "coordinator/field/units.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"
#include "worker/scene/gloss.h"

static const char *const light_kinds[] = {"point", "spot", "directional"};
static const char *const environment_kinds[] = {"none", "constant", "lat-long image"};

/* Reasons why an object's density differs from the common one, as text and as a JSON value; in the order of enum
 * kiln_density_reason. */
static const struct {
    const char *words, *code;
} density_reasons[] = {{"", "common"},
                       {"less: its share of all texels", "share"},
                       {"more: else too few texels", "least-size"},
                       {"density-scale", "density-scale"},
                       {"lightmap-size", "lightmap-size"},
                       {"less: caster-only", "caster-only"},
                       {"less: lightmap-max", "lightmap-max"},
                       {"more: two texels between charts", "padding"},
                       {"less: twice the density of the largest", "bounded"}};
_Static_assert(sizeof density_reasons / sizeof *density_reasons == KILN_DENSITY_REASONS, "a row for each reason");

static const char *role_of(const struct kiln_object *o)
{
    return (o->flags & KILN_OBJECT_CASTER_ONLY) != 0     ? "caster-only"
           : (o->flags & KILN_OBJECT_RECEIVER_ONLY) != 0 ? "receiver-only"
                                                         : "both";
}

enum { OBJECTS_SHOWN = 40 }; /* rows of the table; JSON has all objects */

static double share(uint64_t part, uint64_t whole) { return whole == 0 ? 0.0 : (double)part / (double)whole; }

static const char *string_at(const struct kiln_scene_survey *look, uint32_t offset)
{
    return kiln_scene_string(look->scene, offset);
}

static const char *layout_of(const struct kiln_mesh *mesh)
{
    return (mesh->flags & KILN_MESH_NO_LAYOUT) != 0   ? "none"
           : (mesh->flags & KILN_MESH_REPACKED) != 0  ? "repacked"
           : (mesh->flags & KILN_MESH_UNWRAPPED) != 0 ? "unwrapped"
                                                      : "own";
}

static json_t *meshes_json(const struct kiln_scene_survey *look)
{
    json_t *list = json_array();
    for (size_t i = 0; i < look->scene->mesh_count; i++) {
        const struct kiln_mesh *m = &look->scene->meshes[i];
        (void)json_array_append_new(
            list, json_pack("{s:o, s:I, s:I, s:s, s:b, s:f, s:f}", "name", kiln_json_string(string_at(look, m->name)),
                            "triangles", (json_int_t)m->triangle_count, "vertices", (json_int_t)m->vertex_count,
                            "layout", layout_of(m), "smooth", (m->flags & KILN_MESH_SMOOTH) != 0, "surface_area",
                            m->surface_area, "uv_area", m->uv_area));
    }
    return list;
}

static json_t *objects_json(const struct kiln_scene_survey *look)
{
    json_t *list = json_array();
    for (size_t i = 0; i < look->scene->object_count; i++) {
        const struct kiln_object *o = &look->scene->objects[i];
        const struct kiln_scene_survey_object *figures = &look->objects[i];
        (void)json_array_append_new(
            list, json_pack("{s:o, s:o, s:i, s:[i, i], s:f, s:f, s:s, s:s, s:I, s:f, s:b}", "name",
                            kiln_json_string(string_at(look, o->name)), "original_name",
                            kiln_json_string(string_at(look, o->original_name)), "mesh", (int)o->mesh, "lightmap",
                            (int)o->lightmap_width, (int)o->lightmap_height, "area", figures->area, "texels_per_metre",
                            figures->density, "density_reason", density_reasons[o->density_reason].code, "role",
                            role_of(o), "points", (json_int_t)figures->points, "invalid_share",
                            share(figures->invalid, figures->points), "mirrored", o->flipped != 0));
    }
    return list;
}

/* Describes a material's gloss as JSON. Most keys are names from glTF's materials in snake case, without "Factor"; the
 * rest are kiln's own. `g` NULL: the material has no gloss, and the result is null. */
static json_t *gloss_json(const struct kiln_gloss *g)
{
    static const char *const uses[KILN_GLOSS_USES] = {
        "metallic",  "roughness", "transmission",        "specular",         "specular_color",
        "thickness", "clearcoat", "clearcoat_roughness", "clearcoat_normal", "anisotropy"};
    if (g == NULL)
        return json_null();
    json_t *textures = json_array();
    for (int i = 0; i < KILN_GLOSS_USES; i++)
        if (g->textures[i].texture != KILN_NONE)
            (void)json_array_append_new(textures, json_string(uses[i]));
    json_t *json = json_pack(
        "{s:s, s:f, s:f, s:f, s:f, s:f, s:f, s:[f, f, f], s:f, s:b, s:f, s:f, s:f, s:o}", "model",
        g->model == KILN_GLOSS_PHONG ? "phong" : "metallic-roughness", "metallic", (double)g->metallic, "roughness",
        (double)g->roughness, "mean_metallic", (double)g->mean_metallic, "mean_roughness", (double)g->mean_roughness,
        "ior", (double)g->ior, "specular", (double)g->specular, "specular_color", (double)g->specular_color[0],
        (double)g->specular_color[1], (double)g->specular_color[2], "transmission", (double)g->transmission, "volume",
        (g->flags & KILN_GLOSS_VOLUME) != 0, "thickness", (double)g->thickness, "dispersion", (double)g->dispersion,
        "exponent", (double)g->exponent, "textures", textures);
    json_t *more =
        json_pack("{s:[f, f, f], s:f, s:[f, f, f], s:f, s:f, s:f, s:f, s:b}", "attenuation_color",
                  (double)g->attenuation_color[0], (double)g->attenuation_color[1], (double)g->attenuation_color[2],
                  "attenuation_distance", (double)g->attenuation_distance, "filter", (double)g->filter[0],
                  (double)g->filter[1], (double)g->filter[2], "clearcoat", (double)g->clearcoat, "clearcoat_roughness",
                  (double)g->clearcoat_roughness, "anisotropy", (double)g->anisotropy, "anisotropy_rotation",
                  (double)g->anisotropy_rotation, "mirror", (g->flags & KILN_GLOSS_MIRROR) != 0);
    (void)json_object_update_missing(json, more);
    json_decref(more);
    return json;
}

static json_t *materials_json(const struct kiln_scene_survey *look)
{
    static const char *const alpha[] = {"opaque", "mask", "blend"};
    json_t *list = json_array();
    const struct kiln_scene *s = look->scene;
    size_t maps = 0; /* normal maps of earlier materials: the list of maps is in the same order */
    for (size_t i = 0; i < s->material_count; i++) {
        const struct kiln_material *m = &s->materials[i];
        const bool mapped = maps < s->normal_map_count && s->normal_maps[maps].material == i;
        maps += mapped;
        const struct kiln_gloss *gloss = kiln_gloss_find(s, (uint32_t)i);
        (void)json_array_append_new(
            list, json_pack("{s:o, s:[f, f, f, f], s:[f, f, f], s:b, s:b, s:b, s:f, s:f, s:s, s:b, s:f, s:s, s:o}",
                            "name", kiln_json_string(string_at(look, m->name)), "base_color", (double)m->base_color[0],
                            (double)m->base_color[1], (double)m->base_color[2], (double)m->base_color[3], "emission",
                            (double)m->emission[0], (double)m->emission[1], (double)m->emission[2],
                            "base_color_texture", m->base_color_texture != KILN_NONE, "emission_texture",
                            m->emission_texture != KILN_NONE, "normal_map", mapped, "metallic", (double)m->metallic,
                            "transmission", (double)m->transmission, "alpha", alpha[m->alpha_mode], "double_sided",
                            m->double_sided != 0, "roughness", (double)m->roughness, "kind",
                            kiln_gloss_kind_name(kiln_gloss_kind(m, gloss)), "gloss", gloss_json(gloss)));
    }
    return list;
}

static json_t *lights_json(const struct kiln_scene_survey *look)
{
    json_t *list = json_array();
    for (size_t i = 0; i < look->scene->light_count; i++) {
        const struct kiln_light *l = &look->scene->lights[i];
        (void)json_array_append_new(
            list, json_pack("{s:o, s:s, s:[f, f, f], s:[f, f, f], s:[f, f, f], s:f}", "name",
                            kiln_json_string(string_at(look, l->name)), "kind", light_kinds[l->kind], "position",
                            l->position[0], l->position[1], l->position[2], "direction", (double)l->direction[0],
                            (double)l->direction[1], (double)l->direction[2], "intensity", (double)l->intensity[0],
                            (double)l->intensity[1], (double)l->intensity[2], "range", (double)l->range));
    }
    return list;
}

static json_t *texts_json(const struct kiln_scene_survey *look)
{
    json_t *list = json_array();
    for (size_t i = 0; i < look->scene->note_count; i++) {
        const struct kiln_note *n = &look->scene->notes[i];
        (void)json_array_append_new(list, json_pack("{s:s, s:o}", "severity",
                                                    kiln_note_warns(n->severity) ? "warning" : "information", "text",
                                                    kiln_json_string(string_at(look, n->text))));
    }
    return list;
}

static json_t *cameras_json(const struct kiln_scene_survey *look)
{
    json_t *list = json_array();
    for (size_t i = 0; i < look->scene->camera_count; i++)
        (void)json_array_append_new(list, kiln_json_string(string_at(look, look->scene->cameras[i].name)));
    return list;
}

static json_t *textures_json(const struct kiln_scene_survey *look)
{
    json_t *list = json_array();
    for (size_t i = 0; i < look->scene->texture_count; i++)
        (void)json_array_append_new(list, json_pack("{s:i, s:i}", "width", (int)look->scene->textures[i].width,
                                                    "height", (int)look->scene->textures[i].height));
    return list;
}

static json_t *surface_json(const struct kiln_scene_survey *look)
{
    const struct kiln_surface_report *s = &look->surface;
    return json_pack("{s:I, s:I, s:f, s:f, s:f, s:f, s:I, s:f}", "points", (json_int_t)s->points, "texels",
                     (json_int_t)look->texels, "overlap_share", share(s->overlapped_texels, s->points), "invalid_share",
                     share(look->invalid, s->points), "area", s->geometry_area, "worst_object_area_error",
                     s->worst_object_area_error, "cells", (json_int_t)s->cells_occupied, "cell_size", s->cell_size);
}

static json_t *info_json(const struct kiln_scene_survey *look, const struct kiln_job *job)
{
    const struct kiln_scene *s = look->scene;
    const double *low = s->header->bounds_min, *high = s->header->bounds_max;
    const struct kiln_environment *e = s->environment;
    json_t *environment = json_pack("{s:s, s:[f, f, f], s:i, s:i}", "kind", environment_kinds[e->kind], "radiance",
                                    (double)e->radiance[0], (double)e->radiance[1], (double)e->radiance[2], "width",
                                    (int)e->width, "height", (int)e->height);
    json_t *counts =
        json_pack("{s:i, s:i, s:I, s:I, s:I, s:I, s:i, s:i, s:i, s:i}", "objects", (int)s->object_count, "meshes",
                  (int)s->mesh_count, "triangles", (json_int_t)s->triangle_count, "triangles_expanded",
                  (json_int_t)look->expanded, "triangles_emissive", (json_int_t)look->emissive_triangles, "vertices",
                  (json_int_t)s->vertex_count, "materials", (int)s->material_count, "textures", (int)s->texture_count,
                  "lights", (int)s->light_count, "cameras", (int)s->camera_count);
    return json_pack("{s:s, s:o, s:o, s:s, s:s, s:{s:[f, f, f], s:[f, f, f]}, s:{s:f, s:f, s:f}, s:o, s:o, s:o, s:o, "
                     "s:o, s:o, s:o, s:o, s:o, s:I, s:f}",
                     "status", "done", "scene", kiln_json_string(job->scene.file), "counts", counts, "units",
                     kiln_units_of(job->scene.units, s)->kind, "units_because", kiln_units_reason(job->scene.units, s),
                     "bounds", "min", low[0], low[1], low[2], "max", high[0], high[1], high[2], "texels_per_metre",
                     "min", look->density_min, "median", look->density_median, "max", look->density_max, "surface",
                     surface_json(look), "environment", environment, "meshes", meshes_json(look), "objects",
                     objects_json(look), "materials", materials_json(look), "textures", textures_json(look), "lights",
                     lights_json(look), "cameras", cameras_json(look), "notes", texts_json(look), "scene_file_bytes",
                     (json_int_t)s->mapped_bytes, "import_seconds", look->import.report.seconds);
}

/* Whether no mesh has a layout for lightmaps, as in the scene file of a bake into octrees. */
static bool lacks_layouts(const struct kiln_scene *s)
{
    for (size_t i = 0; i < s->mesh_count; i++)
        if ((s->meshes[i].flags & KILN_MESH_NO_LAYOUT) == 0)
            return false;
    return s->mesh_count > 0;
}

/* Prints the facts about lightmaps. */
static void print_surface(const struct kiln_scene_survey *look)
{
    const struct kiln_scene *s = look->scene;
    const struct kiln_surface_report *r = &look->surface;
    if (lacks_layouts(s)) {
        (void)printf("  layout       none: this scene was baked into octrees, whose leaves are in kiln.h5\n");
        return;
    }
    (void)printf("  density      ");
    if (s->header->texels_per_metre > 0.0f)
        (void)printf("%.3g texels per metre; it comes to ", (double)s->header->texels_per_metre);
    (void)printf("%.3g to %.3g texels per metre, median %.3g\n", look->density_min, look->density_max,
                 look->density_median);
    (void)printf("  lightmaps    %llu texels, %llu of them surface points\n", (unsigned long long)look->texels,
                 (unsigned long long)r->points);
    (void)printf("  overlap      %.3g %% of the points are shared by charts\n",
                 100.0 * share(r->overlapped_texels, r->points));
    (void)printf("  invalid      %.3g %% of the points lie inside other geometry\n",
                 100.0 * share(look->invalid, r->points));
    (void)printf("  area         %.6g m2; texel areas of the worst object are off by %.2g %%\n", r->geometry_area,
                 100.0 * r->worst_object_area_error);
}

static void print_counts(const struct kiln_scene_survey *look, const struct kiln_job *job)
{
    const struct kiln_scene *s = look->scene;
    const double *low = s->header->bounds_min, *high = s->header->bounds_max;
    const struct kiln_environment *e = s->environment;
    const struct kiln_units *units = kiln_units_of(job->scene.units, s);
    kiln_print(stdout, "%s\n", job->scene.file);
    (void)printf("  objects      %zu of %zu meshes\n", s->object_count, s->mesh_count);
    (void)printf("  triangles    %zu stored, %llu with instances expanded, %llu of these emit\n", s->triangle_count,
                 (unsigned long long)look->expanded, (unsigned long long)look->emissive_triangles);
    (void)printf("  materials    %zu, textures %zu, lights %zu, cameras %zu\n", s->material_count, s->texture_count,
                 s->light_count, s->camera_count);
    (void)printf("  size         %.6g x %.6g x %.6g m around (%.6g, %.6g, %.6g)\n", high[0] - low[0], high[1] - low[1],
                 high[2] - low[2], s->header->centre[0], s->header->centre[1], s->header->centre[2]);
    (void)printf("  environment  %s", environment_kinds[e->kind]);
    if (e->kind == KILN_ENVIRONMENT_CONSTANT)
        (void)printf(", radiance %g %g %g %s", (double)e->radiance[0], (double)e->radiance[1], (double)e->radiance[2],
                     units->radiance);
    if (e->kind == KILN_ENVIRONMENT_LATLONG)
        (void)printf(", %u x %u", e->width, e->height);
    (void)printf("\n  units        %s, %s: %s (--units says otherwise)", units->kind, units->irradiance_text,
                 kiln_units_reason(job->scene.units, s));
    (void)fputc('\n', stdout);
    print_surface(look);
}

static int print_objects(const struct kiln_scene_survey *look, bool all, struct kiln_error *error)
{
    enum { COLUMNS = 8, CELL = 32 };
    static const char *const head[COLUMNS] = {"object",   "mesh",     "layout",  "triangles",
                                              "lightmap", "texels/m", "invalid", "density is"};
    const struct kiln_scene *s = look->scene;
    const size_t rows = all || s->object_count <= OBJECTS_SHOWN ? s->object_count : OBJECTS_SHOWN;
    const char **cells = NULL;
    char(*texts)[4][CELL] = NULL;
    int status;
    KILN_TRY(kiln_allocate(&cells, (rows + 1) * COLUMNS, sizeof *cells, "a table", error));
    KILN_TRY(kiln_allocate(&texts, rows, sizeof *texts, "a table", error));
    if (rows > 0) {
        memcpy(cells, head, sizeof head);
        for (size_t i = 0; i < rows; i++) {
            const struct kiln_object *o = &s->objects[i];
            const struct kiln_mesh *m = &s->meshes[o->mesh];
            const struct kiln_scene_survey_object *figures = &look->objects[i];
            (void)snprintf(texts[i][0], CELL, "%llu", (unsigned long long)m->triangle_count);
            (void)snprintf(texts[i][1], CELL, "%u x %u", o->lightmap_width, o->lightmap_height);
            (void)snprintf(texts[i][2], CELL, "%.3g", figures->density);
            (void)snprintf(texts[i][3], CELL, "%.2g %%", 100.0 * share(figures->invalid, figures->points));
            const char *const row[COLUMNS] = {string_at(look, o->name),
                                              string_at(look, m->name),
                                              layout_of(m),
                                              texts[i][0],
                                              texts[i][1],
                                              texts[i][2],
                                              texts[i][3],
                                              density_reasons[o->density_reason].words};
            memcpy(cells + (i + 1) * COLUMNS, row, sizeof row);
        }
        (void)fputc('\n', stdout);
        kiln_table_print(stdout, cells, rows + 1, COLUMNS, 0x78u);
        if (rows < s->object_count)
            (void)printf("... and %zu more (--verbose shows all)\n", s->object_count - rows);
    }
end:
    kiln_free(&texts);
    kiln_free(&cells);
    return status;
}

static void print_glass(const struct kiln_scene_survey *look, const struct kiln_material *m)
{
    const double t = (double)m->transmission * (1.0 - (double)m->metallic);
    kiln_print(stdout, "glass '%s': transmits %.3g %.3g %.3g%s%s%s\n", string_at(look, m->name),
               t * (double)m->base_color[0], t * (double)m->base_color[1], t * (double)m->base_color[2],
               m->base_color_texture != KILN_NONE ? ", times its base colour's texture" : "",
               m->transmission_texture != KILN_NONE ? ", times its transmission's texture" : "",
               m->alpha_mode == KILN_ALPHA_OPAQUE ? "" : "; holes by its alpha");
}

/* Prints the parameters of a glossy material, after its kind. */
static void print_gloss(const struct kiln_gloss *g)
{
    const bool glass = g->transmission > 0.0f, body = (g->flags & KILN_GLOSS_VOLUME) != 0;
    if (g->model == KILN_GLOSS_PHONG)
        (void)printf(", Phong %s of %g %g %g", (g->flags & KILN_GLOSS_MIRROR) != 0 ? "mirror" : "lobe",
                     (double)g->specular_color[0], (double)g->specular_color[1], (double)g->specular_color[2]);
    if (g->model == KILN_GLOSS_PHONG && (g->flags & KILN_GLOSS_MIRROR) == 0)
        (void)printf(", exponent %g", (double)g->exponent);
    if (g->mean_metallic > 0.0f)
        (void)printf(", metallic %.3g", (double)g->mean_metallic);
    if (g->model != KILN_GLOSS_PHONG)
        (void)printf(", roughness %.3g", (double)g->mean_roughness);
    if (g->anisotropy > 0.0f)
        (void)printf(", anisotropy %.3g", (double)g->anisotropy);
    if (glass)
        (void)printf(", transmission %.3g", (double)g->transmission);
    if (g->ior != 1.5f || glass)
        (void)printf(", index %g", (double)g->ior);
    if (body && g->attenuation_distance > 0.0f)
        (void)printf(", white becomes %g %g %g in %g m", (double)g->attenuation_color[0],
                     (double)g->attenuation_color[1], (double)g->attenuation_color[2], (double)g->attenuation_distance);
    if (body && g->dispersion > 0.0f)
        (void)printf(", Abbe number %.3g", 20.0 / (double)g->dispersion);
    if (g->clearcoat > 0.0f)
        (void)printf(", clear coat %.3g of roughness %.3g", (double)g->clearcoat, (double)g->clearcoat_roughness);
}

/* Lists the materials that are more than diffuse. */
static void print_kinds(const struct kiln_scene_survey *look, bool all)
{
    const struct kiln_scene *s = look->scene;
    size_t shown = 0, found = 0, bent = 0;
    for (size_t i = 0; i < s->material_count; i++) {
        const struct kiln_gloss *known = kiln_gloss_find(s, (uint32_t)i);
        const struct kiln_gloss gloss = known != NULL ? *known : kiln_gloss_default(&s->materials[i], (uint32_t)i);
        const enum kiln_gloss_kind kind = kiln_gloss_kind(&s->materials[i], &gloss);
        bent += kind != KILN_GLOSS_KIND_DIFFUSE && !kiln_gloss_is_passage(&gloss);
        if (kind == KILN_GLOSS_KIND_DIFFUSE || (found++ >= OBJECTS_SHOWN && !all))
            continue;
        (void)fputs(shown++ == 0 ? "\n" : "", stdout);
        kiln_print(stdout, "material '%s': %s", string_at(look, s->materials[i].name), kiln_gloss_kind_name(kind));
        print_gloss(&gloss);
        (void)fputs("\n", stdout);
    }
    if (found > shown)
        (void)printf("... and %zu more (--verbose shows all)\n", found - shown);
    if (bent > 0)
        (void)printf("a bake has the light that %s sends on; --materials diffuse leaves it out, in less time: metal "
                     "reflects nothing then, and glass is thin walls\n",
                     found == 1 ? "this material" : "each of these materials");
}

static void print_texts(const struct kiln_scene_survey *look, const struct kiln_job *job)
{
    const struct kiln_scene *s = look->scene;
    const struct kiln_units *units = kiln_units_of(job->scene.units, s);
    if (s->camera_count > 0)
        (void)fputs("\ncameras:", stdout);
    for (size_t i = 0; i < s->camera_count; i++)
        kiln_print(stdout, " '%s'", string_at(look, s->cameras[i].name));
    (void)fputs(s->camera_count > 0 ? "\n" : "", stdout);
    (void)fputs(s->light_count > 0 ? "\n" : "", stdout);
    for (size_t i = 0; i < s->light_count; i++)
        kiln_print(stdout, "light '%s': %s, %g %g %g %s\n", string_at(look, s->lights[i].name),
                   light_kinds[s->lights[i].kind], (double)s->lights[i].intensity[0], (double)s->lights[i].intensity[1],
                   (double)s->lights[i].intensity[2],
                   s->lights[i].kind == KILN_LIGHT_DIRECTIONAL ? units->irradiance : units->intensity);
    print_kinds(look, job->verbose);
    for (size_t i = 0, shown = 0; i < s->material_count; i++)
        if (s->materials[i].transmission > 0.0f) {
            (void)fputs(shown++ == 0 ? "\n" : "", stdout);
            print_glass(look, &s->materials[i]);
        }
    (void)fputs(s->note_count > 0 ? "\n" : "", stdout);
    for (size_t i = 0; i < s->note_count; i++)
        kiln_print(stdout, "%s: %s\n", kiln_note_warns(s->notes[i].severity) ? "warning" : "note",
                   string_at(look, s->notes[i].text));
}

int kiln_command_info(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_scene_survey *look = NULL;
    if (job->machine.devices)
        return kiln_devices_list(job, error);
    int status = kiln_scene_survey_create(&look, job, error);
    if (status == KILN_OK && job->json) {
        status = kiln_json_print(info_json(look, job), error);
    } else if (status == KILN_OK) {
        print_counts(look, job);
        status = print_objects(look, job->verbose, error);
        print_texts(look, job);
    }
    kiln_scene_survey_destroy(&look);
    return status;
}
