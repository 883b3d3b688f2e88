#include "coordinator/import/gltf.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Extensions that a file may require: those that kiln reads, and those without effect on diffuse light. */
static const char *const supported[] = {"KHR_materials_emissive_strength",
                                        "KHR_texture_transform",
                                        "KHR_lights_punctual",
                                        "EXT_mesh_gpu_instancing",
                                        "KHR_mesh_quantization",
                                        "KHR_draco_mesh_compression",
                                        "EXT_meshopt_compression",
                                        "KHR_materials_ior",
                                        "KHR_materials_specular",
                                        "KHR_materials_sheen",
                                        "KHR_materials_clearcoat",
                                        "KHR_materials_transmission",
                                        "KHR_materials_volume",
                                        "KHR_materials_unlit",
                                        "KHR_materials_pbrSpecularGlossiness",
                                        "KHR_materials_variants",
                                        "KHR_node_visibility",
                                        "KHR_node_selectability",
                                        "KHR_node_hoverability",
                                        "KHR_animation_pointer",
                                        "KHR_xmp_json_ld",
                                        "KHR_materials_iridescence",
                                        "KHR_materials_anisotropy",
                                        "KHR_materials_dispersion"};

static const struct {
    const char *name, *remedy;
} remedies[] = {
    {"KHR_meshopt_compression", "export again with EXT_meshopt_compression or without compression"},
    {"EXT_texture_webp", "export again with PNG or JPEG textures instead of WebP"},
    {"KHR_texture_basisu", "export again with PNG or JPEG textures instead of KTX2"},
    {"EXT_texture_avif", "export again with PNG or JPEG textures instead of AVIF"},
    {"MSFT_texture_dds", "export again with PNG or JPEG textures instead of DDS"},
};

static bool is_supported(const char *name)
{
    for (size_t i = 0; i < sizeof supported / sizeof supported[0]; i++)
        if (strcmp(name, supported[i]) == 0)
            return true;
    return false;
}

static void check_extensions(struct gltf *g)
{
    const json_t *required = gltf_array(g, (struct gltf_place){0}, g->root, "extensionsRequired");
    for (size_t i = 0; i < json_array_size(required) && g->status == KILN_OK; i++) {
        const char *name = json_string_value(json_array_get(required, i));
        if (name == NULL) {
            gltf_fail(g, (struct gltf_place){"extensionsRequired", i, ""}, "", "is not a string");
            return;
        }
        if (is_supported(name))
            continue;
        const char *remedy = "export again without it";
        for (size_t k = 0; k < sizeof remedies / sizeof remedies[0]; k++)
            if (strcmp(name, remedies[k].name) == 0)
                remedy = remedies[k].remedy;
        g->status = kiln_fail(g->error, KILN_BAD_INPUT,
                              "%.512s: extensionsRequired[%zu] is '%.80s', which kiln cannot read; %s",
                              g->confine->scene, i, name, remedy);
    }
}

static void check_asset(struct gltf *g)
{
    const struct gltf_place place = {0};
    const json_t *asset = gltf_object(g, place, g->root, "asset");
    const char *version = gltf_string(g, place, asset, "version");
    const char *least = gltf_string(g, place, asset, "minVersion");
    if (g->status == KILN_OK && version == NULL)
        gltf_fail(g, place, "asset.version", "is missing");
    if (g->status == KILN_OK && strncmp(version, "2.", 2) != 0)
        gltf_fail(g, place, "asset.version", "is '%.20s'; kiln reads glTF 2", version);
    if (g->status == KILN_OK && least != NULL && strcmp(least, "2.0") != 0)
        gltf_fail(g, place, "asset.minVersion", "is '%.20s'; kiln reads glTF 2.0", least);
}

/* The units that an object's extras state: "radiometric" or "photometric". */
static uint32_t stated_units(const json_t *object)
{
    const char *said = json_string_value(json_object_get(json_object_get(object, "extras"), "units"));
    if (said != NULL && strcmp(said, "photometric") == 0)
        return KILN_SCENE_UNITS_PHOTOMETRIC;
    return said != NULL && strcmp(said, "radiometric") == 0 ? KILN_SCENE_UNITS_RADIOMETRIC : KILN_SCENE_UNITS_UNKNOWN;
}

static bool emits(const struct kiln_builder *builder)
{
    const struct kiln_material *materials =
        KILN_BUILDER_DATA(builder, const struct kiln_material, KILN_SECTION_MATERIALS);
    bool found = false;
    for (size_t i = 0; i < builder->sections[KILN_SECTION_MATERIALS].count; i++)
        found = found || materials[i].emission[0] > 0.0f || materials[i].emission[1] > 0.0f ||
                materials[i].emission[2] > 0.0f;
    return found;
}

/* Finds the units of the file's lights (coordinator/field/units.h). Blender's exporter converts the watts of lamps to
 * lumens but leaves emission as it is: lamps and emitting surfaces are then a factor of 683 apart. */
static void find_units(struct gltf *g)
{
    const json_t *asset = json_object_get(g->root, "asset");
    const json_t *scene =
        json_array_get(json_object_get(g->root, "scenes"),
                       (size_t)gltf_whole(g, (struct gltf_place){0}, g->root, "scene", 0, UINT32_MAX, 0));
    const char *generator = json_string_value(json_object_get(asset, "generator"));
    const bool blender = generator != NULL && strstr(generator, "Khronos glTF Blender I/O") != NULL;
    g->builder->units = stated_units(scene) != KILN_SCENE_UNITS_UNKNOWN ? stated_units(scene) : stated_units(asset);
    if (g->builder->units != KILN_SCENE_UNITS_UNKNOWN || !blender ||
        g->builder->sections[KILN_SECTION_LIGHTS].count == 0)
        return;
    g->builder->units = KILN_SCENE_UNITS_BLENDER;
    if (emits(g->builder))
        gltf_take(g, kiln_builder_note(
                         g->builder, 1, g->error,
                         "Blender exported the lamps in candela and lux, 683 for a watt, but emitting surfaces in "
                         "watts: beside the lamps these are 683 times too dark; export with the lighting mode "
                         "'Unitless' or 'Raw' instead"));
}

void gltf_check(struct gltf *g)
{
    check_asset(g);
    if (g->status == KILN_OK)
        check_extensions(g);
}

/* Writes one note for each kind of oddity, with the number of its occurrences. */
static void write_notes(struct gltf *g)
{
    const struct {
        uint64_t count;
        uint32_t severity;
        const char *text;
    } notes[] = {
        {g->assembly.without_area, KILN_NOTE_REPEATED, "triangles without area were left out"},
        {g->assembly.replaced_normals, 1,
         "corner normals were zero or pointed to the back of their triangle; the geometric normal replaces them"},
        {g->without_material, 0, "primitives have no material: they are diffuse grey, 0.8"},
        {g->missing_texcoords, 1,
         "primitives lack the texture coordinates their material asks for; the texture's corner colour is used"},
        {g->missing_normal_texcoords, 1,
         "primitives lack the texture coordinates that their material's normal map asks for; kiln view shows them "
         "without it"},
        {g->missing_gloss_texcoords, 1,
         "primitives lack the texture coordinates that their material's gloss asks for; its textures' corner colours "
         "are used"},
        {g->clamped_colors, 1, "primitives had vertex colours outside 0..1; they were clamped"},
        {g->without_area_objects, KILN_NOTE_REPEATED, "objects are scaled to nothing and were left out"},
        {g->skipped_lights, KILN_NOTE_REPEATED, "lights are scaled to nothing and were left out"},
        {g->hard_spots, KILN_NOTE_REPEATED,
         "spot lights have the same inner and outer angle, which glTF does not allow; their cones have hard edges"},
        {g->skins, 0, "skinned meshes are baked in the pose that their joints' nodes have"},
        {g->morphs, 0, "morph targets are baked with the weights that the file gives, 0 where it gives none"},
    };
    for (size_t i = 0; i < sizeof notes / sizeof notes[0]; i++)
        if (notes[i].count > 0)
            gltf_take(g, kiln_builder_note(g->builder, notes[i].severity, g->error, "%llu %s",
                                           (unsigned long long)notes[i].count, notes[i].text));
}

void gltf_close(struct gltf *g)
{
    for (size_t i = 0; g->buffers != NULL && i < g->buffer_count; i++) {
        kiln_file_unmap(&g->buffers[i].file);
        kiln_free(&g->buffers[i].owned);
    }
    for (size_t i = 0; g->views != NULL && i < g->view_count; i++)
        kiln_free(&g->views[i].owned);
    kiln_images_destroy(&g->images);
    kiln_arena_release(&g->arena);
    kiln_names_destroy(&g->names);
    json_decref(g->root);
    kiln_file_unmap(&g->file);
}

int kiln_gltf_read(struct kiln_confine *confine, struct kiln_builder *builder, struct kiln_error *error)
{
    static void (*const steps[])(struct gltf *) = {
        gltf_open,       gltf_check,     gltf_read_buffers, gltf_read_accessors, gltf_read_materials,
        gltf_read_scene, gltf_read_lods, find_units,        write_notes,         gltf_note_unused};
    struct gltf g = {.confine = confine, .builder = builder, .error = error};
    for (size_t i = 0; i < sizeof steps / sizeof steps[0] && g.status == KILN_OK; i++)
        steps[i](&g);
    if (g.status == KILN_OK && builder->sections[KILN_SECTION_MATERIALS].count == 0)
        (void)gltf_default_material(&g); /* a scene file has at least one material */
    gltf_close(&g);
    return g.status;
}
