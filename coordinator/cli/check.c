/* kiln check: lists every problem of a scene that can be found without baking it, with its place and severity. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/bake/prepare/scene_survey.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"
#include "worker/scene/gloss.h"

static const double density_outlier = 4.0, buried_share = 0.5, bright_albedo = 0.98;

enum severity { INFORMATION, WARNING };

struct problem {
    enum severity severity;
    char place[160];
    char text[1024];
};

struct report {
    const struct kiln_scene_survey *look;
    struct problem *problems;
    size_t count, capacity;
    int status;
    struct kiln_error *error;
};

__attribute__((format(printf, 5, 6))) static void add(struct report *r, enum severity severity, const char *kind,
                                                      const char *name, const char *format, ...)
{
    if (r->status != KILN_OK)
        return;
    r->status = kiln_grow(&r->problems, &r->capacity, r->count + 1, sizeof *r->problems, "problems", r->error);
    if (r->status != KILN_OK)
        return;
    struct problem *p = &r->problems[r->count++];
    p->severity = severity;
    (void)snprintf(p->place, sizeof p->place, "%s%s%.120s%s", kind, name[0] != '\0' ? " '" : "", name,
                   name[0] != '\0' ? "'" : "");
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(p->text, sizeof p->text, format, arguments);
    va_end(arguments);
}

static const char *text_at(const struct report *r, uint32_t offset)
{
    return kiln_scene_string(r->look->scene, offset);
}

static void check_notes(struct report *r)
{
    const struct kiln_scene *s = r->look->scene;
    for (size_t i = 0; i < s->note_count; i++)
        add(r, kiln_note_warns(s->notes[i].severity) ? WARNING : INFORMATION, "import", "", "%s",
            text_at(r, s->notes[i].text));
}

static void check_lights(struct report *r)
{
    const struct kiln_scene *s = r->look->scene;
    for (size_t i = 0; i < s->light_count; i++) {
        const float *intensity = s->lights[i].intensity;
        if (intensity[0] + intensity[1] + intensity[2] == 0.0f)
            add(r, WARNING, "light", text_at(r, s->lights[i].name), "it is dark: its intensity is 0");
    }
    if (s->light_count == 0 && r->look->emissive_triangles == 0 && s->environment->kind == KILN_ENVIRONMENT_NONE)
        add(r, WARNING, "scene", "",
            "there is no light: no emissive triangle, no light, no environment (--environment R,G,B gives one)");
}

static void check_enclosed(struct report *r)
{
    char text[512];
    for (size_t i = 0; i < r->look->enclosed_count; i++) {
        const struct kiln_enclosed_light *light = &r->look->enclosed[i];
        kiln_enclosed_light_text(light, r->look->scene, text, sizeof text);
        add(r, WARNING, "light", kiln_enclosed_light_name(light, r->look->scene), "%s", text);
    }
}

static void check_gloss(struct report *r, const struct kiln_material *m, const struct kiln_gloss *gloss)
{
    const char *name = text_at(r, m->name);
    if (kiln_gloss_kind(m, gloss) == KILN_GLOSS_KIND_THIN_GLASS)
        add(r, INFORMATION, "material", name,
            "it transmits light but bounds no body, so that it is a thin wall, which bends no light: glass that is to "
            "gather light into caustics needs KHR_materials_volume with a thickness above 0 (illum 6 or 7 in MTL)");
    if (gloss->mean_metallic > 0.0f && m->metallic < 1.0f)
        add(r, INFORMATION, "material", name,
            "%.3g %% of it is metal, and --materials diffuse leaves out what metal reflects",
            100.0 * (double)gloss->mean_metallic);
}

static void check_materials(struct report *r)
{
    const struct kiln_scene *s = r->look->scene;
    for (size_t i = 0; i < s->material_count; i++) {
        const struct kiln_material *m = &s->materials[i];
        const float brightest = fmaxf(m->base_color[0], fmaxf(m->base_color[1], m->base_color[2]));
        const struct kiln_gloss *gloss = kiln_gloss_find(s, (uint32_t)i);
        if (gloss != NULL)
            check_gloss(r, m, gloss);
        if (m->metallic >= 1.0f)
            add(r, INFORMATION, "material", text_at(r, m->name), "it is a metal and reflects no diffuse light");
        else if ((double)brightest * (1.0 - (double)m->metallic) > bright_albedo && m->base_color_texture == KILN_NONE)
            add(r, INFORMATION, "material", text_at(r, m->name),
                "its albedo of %.3f makes very many bounces necessary; real paint is below 0.9",
                (double)brightest * (1.0 - (double)m->metallic));
    }
}

/* Finds emissive materials whose texture is black all over their triangles. */
static void check_emitters(struct report *r)
{
    const struct kiln_scene *s = r->look->scene;
    for (size_t i = 0; i < s->mesh_count && r->look->emissive_triangles == 0; i++) {
        const struct kiln_mesh *mesh = &s->meshes[i];
        for (uint64_t t = mesh->triangle_first; t < mesh->triangle_first + mesh->triangle_count; t++) {
            const struct kiln_material *m = &s->materials[s->triangle_materials[t]];
            if (m->emission[0] + m->emission[1] + m->emission[2] > 0.0f) {
                add(r, WARNING, "mesh", text_at(r, mesh->name),
                    "material '%.80s' emits, but its texture is black all over the mesh", text_at(r, m->name));
                break;
            }
        }
    }
}

/* ---- closed meshes that face inward ---- */

struct edge {
    uint32_t low, high;
    int32_t sense; /* +1: the edge runs from the lower to the higher vertex number */
};

static int compare_edges(const void *a, const void *b)
{
    const struct edge *x = a, *y = b;
    if (x->low != y->low)
        return x->low < y->low ? -1 : 1;
    return x->high < y->high ? -1 : x->high > y->high;
}

/* A vertex for sorting; it carries its position, since the comparison of qsort has no further argument. */
struct place {
    struct kiln_vec3 position;
    uint32_t vertex;
};

static int compare_places(const void *a, const void *b)
{
    const struct place *x = a, *y = b;
    const int order = memcmp(&x->position, &y->position, sizeof x->position);
    return order != 0 ? order : (x->vertex > y->vertex) - (x->vertex < y->vertex);
}

/* Merges vertices by position: welded[v] is the same number for all vertices at one position. */
static int weld(const struct kiln_vec3 *positions, size_t count, uint32_t *welded, struct kiln_error *error)
{
    struct place *places = NULL;
    const int status = kiln_allocate(&places, count, sizeof *places, "vertices", error);
    if (status != KILN_OK)
        return status;
    for (size_t v = 0; v < count; v++)
        places[v] = (struct place){positions[v], (uint32_t)v};
    qsort(places, count, sizeof *places, compare_places);
    for (size_t v = 0; v < count; v++) {
        const bool same = v > 0 && memcmp(&places[v].position, &places[v - 1].position, sizeof places[v].position) == 0;
        welded[places[v].vertex] = same ? welded[places[v - 1].vertex] : places[v].vertex;
    }
    kiln_free(&places);
    return KILN_OK;
}

/* Finds out whether the mesh is closed, that is, each edge occurs once in each direction, and its signed volume
 * (positive: triangles face outward). */
static int closed_volume(const struct kiln_scene *s, const struct kiln_mesh *mesh, bool *closed, double *volume,
                         struct kiln_error *error)
{
    const struct kiln_vec3 *positions = s->positions + mesh->vertex_first;
    const uint32_t *corners = s->triangles + 3 * mesh->triangle_first;
    const size_t count = (size_t)mesh->triangle_count;
    uint32_t *welded = NULL;
    struct edge *edges = NULL;
    int status;
    KILN_TRY(kiln_allocate(&welded, (size_t)mesh->vertex_count, sizeof *welded, "vertices", error));
    KILN_TRY(kiln_allocate(&edges, 3 * count, sizeof *edges, "edges", error));
    KILN_TRY(weld(positions, (size_t)mesh->vertex_count, welded, error));
    *volume = 0.0;
    for (size_t t = 0; t < count; t++) {
        struct kiln_dvec3 p[3];
        for (size_t c = 0; c < 3; c++) {
            const uint32_t a = welded[corners[3 * t + c]], b = welded[corners[3 * t + (c + 1) % 3]];
            edges[3 * t + c] = (struct edge){a < b ? a : b, a < b ? b : a, a < b ? 1 : -1};
            p[c] = dvec3_sub(dvec3_of(positions[corners[3 * t + c]]), dvec3_of(positions[corners[0]]));
        }
        *volume += dvec3_dot(p[0], dvec3_cross(p[1], p[2])) / 6.0;
    }
    qsort(edges, 3 * count, sizeof *edges, compare_edges);
    *closed = count > 0;
    for (size_t e = 0; e < 3 * count && *closed; e += 2)
        *closed = e + 1 < 3 * count && compare_edges(&edges[e], &edges[e + 1]) == 0 &&
                  edges[e].sense + edges[e + 1].sense == 0 &&
                  (e + 2 >= 3 * count || compare_edges(&edges[e], &edges[e + 2]) != 0);
end:
    kiln_free(&edges);
    kiln_free(&welded);
    return status;
}

/* The first material of a mesh that is glass with a volume; NULL: none is. */
static const struct kiln_material *body_material(const struct kiln_scene *s, const struct kiln_mesh *mesh)
{
    for (uint64_t t = 0; s->gloss_count > 0 && t < mesh->triangle_count; t++) {
        const uint32_t material = s->triangle_materials[mesh->triangle_first + t];
        const struct kiln_gloss *gloss = kiln_gloss_find(s, material);
        if (gloss != NULL && kiln_gloss_kind(&s->materials[material], gloss) == KILN_GLOSS_KIND_VOLUME_GLASS)
            return &s->materials[material];
    }
    return NULL;
}

static void check_meshes(struct report *r)
{
    const struct kiln_scene *s = r->look->scene;
    for (size_t i = 0; i < s->mesh_count && r->status == KILN_OK; i++) {
        const struct kiln_mesh *mesh = &s->meshes[i];
        bool closed = false;
        double volume = 0.0;
        if ((mesh->flags & KILN_MESH_REPACKED) != 0)
            add(r, INFORMATION, "mesh", text_at(r, mesh->name),
                "the charts of its second UV set are packed again; a viewer needs kiln's layout");
        else if ((mesh->flags & KILN_MESH_UNWRAPPED) != 0)
            add(r, INFORMATION, "mesh", text_at(r, mesh->name),
                "it has no usable second UV set and is unwrapped; a viewer needs kiln's layout");
        r->status = closed_volume(s, mesh, &closed, &volume, r->error);
        const struct kiln_material *body = closed ? NULL : body_material(s, mesh);
        if (body != NULL)
            add(r, WARNING, "mesh", text_at(r, mesh->name),
                "its material '%.80s' is glass with a volume, which the mesh has to bound, but the mesh is not closed: "
                "close it, or make the glass a thin wall (thickness 0)",
                text_at(r, body->name));
        if (closed && volume < 0.0)
            add(r, WARNING, "mesh", text_at(r, mesh->name),
                "it is closed and faces inward: right for a room seen from inside, wrong for a solid (turn its "
                "triangles round)");
    }
}

static void check_objects(struct report *r)
{
    const struct kiln_scene *s = r->look->scene;
    for (size_t i = 0; i < s->object_count; i++) {
        const struct kiln_scene_survey_object *o = &r->look->objects[i];
        const char *name = text_at(r, s->objects[i].name);
        const double ratio = r->look->density_median > 0.0 ? o->density / r->look->density_median : 1.0;
        const bool chosen =
            s->objects[i].density_reason != KILN_DENSITY_COMMON && s->objects[i].density_reason != KILN_DENSITY_MAX;
        if (!chosen && o->density > 0.0 && (ratio > density_outlier || ratio < 1.0 / density_outlier))
            add(r, WARNING, "object", name, "its %.3g texels per metre are far from the median of %.3g", o->density,
                r->look->density_median);
        if (o->points > 0 && (double)o->invalid > buried_share * (double)o->points)
            add(r, WARNING, "object", name, "%.0f %% of its surface lies inside other geometry",
                100.0 * (double)o->invalid / (double)o->points);
        if (o->points == 0)
            add(r, WARNING, "object", name, "it covers no texel");
    }
    if (r->look->surface.overlapped_texels > 0)
        add(r, INFORMATION, "lightmaps", "", "%llu of %llu surface points are shared by charts",
            (unsigned long long)r->look->surface.overlapped_texels, (unsigned long long)r->look->surface.points);
}

static json_t *report_json(const struct report *r, const struct kiln_job *job)
{
    json_t *list = json_array();
    json_int_t warnings = 0;
    for (size_t i = 0; i < r->count; i++) {
        const struct problem *p = &r->problems[i];
        warnings += p->severity == WARNING;
        (void)json_array_append_new(list, json_pack("{s:s, s:o, s:o}", "severity",
                                                    p->severity == WARNING ? "warning" : "information", "place",
                                                    kiln_json_string(p->place), "text", kiln_json_string(p->text)));
    }
    return json_pack("{s:s, s:o, s:I, s:o}", "status", "done", "scene", kiln_json_string(job->scene.file), "warnings",
                     warnings, "problems", list);
}

static void print_report(const struct report *r, const struct kiln_job *job)
{
    size_t warnings = 0;
    for (int severity = WARNING; severity >= INFORMATION; severity--)
        for (size_t i = 0; i < r->count; i++) {
            const struct problem *p = &r->problems[i];
            warnings += (int)p->severity == severity && severity == WARNING;
            if ((int)p->severity == severity)
                kiln_print(stdout, "%s: %s: %s\n", severity == WARNING ? "warning" : "note", p->place, p->text);
        }
    kiln_print(stdout, "%s: %zu warning%s, %zu note%s\n", job->scene.file, warnings, warnings == 1 ? "" : "s",
               r->count - warnings, r->count - warnings == 1 ? "" : "s");
}

int kiln_command_check(struct kiln_job *job, struct kiln_error *error)
{
    static void (*const checks[])(struct report *) = {check_notes,    check_lights, check_enclosed, check_materials,
                                                      check_emitters, check_meshes, check_objects};
    struct kiln_scene_survey *look = NULL;
    struct report report = {.error = error};
    report.status = kiln_scene_survey_create(&look, job, error);
    report.look = look;
    for (size_t i = 0; i < sizeof checks / sizeof checks[0] && report.status == KILN_OK; i++)
        checks[i](&report);
    if (report.status == KILN_OK && job->json)
        report.status = kiln_json_print(report_json(&report, job), error);
    else if (report.status == KILN_OK)
        print_report(&report, job);
    kiln_free(&report.problems);
    kiln_scene_survey_destroy(&look);
    return report.status;
}
