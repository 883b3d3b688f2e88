#include "coordinator/import/read.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <xxhash.h>

#include "coordinator/import/assemble.h"
#include "coordinator/import/changes.h"
#include "coordinator/import/constant_textures.h"
#include "coordinator/import/gltf.h"
#include "coordinator/import/image.h"
#include "coordinator/import/numbers.h"
#include "coordinator/import/obj.h"
#include "coordinator/import/parts.h"
#include "coordinator/import/settings.h"
#include "worker/base/memory.h"

enum reader { READER_NONE, READER_GLTF, READER_OBJ, READER_PARTS };

static enum reader reader_of(const char *name)
{
    static const struct {
        const char *extension;
        enum reader reader;
    } readers[] = {{".gltf", READER_GLTF}, {".glb", READER_GLTF}, {".obj", READER_OBJ}, {".parts", READER_PARTS}};
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot != NULL && i < sizeof readers / sizeof readers[0]; i++)
        if (strcasecmp(dot, readers[i].extension) == 0)
            return readers[i].reader;
    return READER_NONE;
}

/* Parses "R,G,B", three numbers from 0 to KILN_LIGHT_MOST; false if it is anything else. */
static bool parse_radiance(const char *text, float rgb[3])
{
    for (int c = 0; c < 3; c++) {
        char *rest;
        const double value = strtod(text, &rest);
        if (rest == text || *rest != (c < 2 ? ',' : '\0') || !kiln_number_fits(KILN_NUMBER_LIGHT, value))
            return false;
        rgb[c] = (float)value;
        text = rest + 1;
    }
    return true;
}

static int read_environment_image(const struct kiln_import_params *params, struct kiln_confine *confine,
                                  struct kiln_builder *builder, struct kiln_environment *environment,
                                  struct kiln_error *error)
{
    struct kiln_file file;
    char where[600];
    (void)snprintf(where, sizeof where, "%.512s: the environment", params->environment);
    int status = kiln_confine_map_named(confine, builder, params->environment, &file, error);
    if (status != KILN_OK)
        return status;
    status = kiln_image_append_environment(builder, file.data, file.size, where, &environment->width,
                                           &environment->height, error);
    kiln_file_unmap(&file);
    environment->kind = KILN_ENVIRONMENT_LATLONG;
    environment->radiance[0] = environment->radiance[1] = environment->radiance[2] = 1.0f;
    return status;
}

/* Checks that the brightest texel, scaled, is small enough for sums of light. */
static int check_texels(const struct kiln_builder *builder, const struct kiln_environment *environment,
                        struct kiln_error *error)
{
    const float *texels = KILN_BUILDER_DATA(builder, const float, KILN_SECTION_ENVIRONMENT_TEXELS);
    float most = 0.0f;
    for (size_t i = 0; i < builder->sections[KILN_SECTION_ENVIRONMENT_TEXELS].count; i++)
        most = fmaxf(most, texels[i] * environment->radiance[i % 3]);
    if (kiln_number_fits(KILN_NUMBER_LIGHT, (double)most))
        return KILN_OK;
    return kiln_fail(
        error, KILN_USAGE,
        "the environment's brightest texel, scaled, is %g, more than %g; give a smaller --environment-scale",
        (double)most, KILN_LIGHT_MOST);
}

/* Sets the environment that the user asks for, or the scene's own, scaled and rotated. */
static int set_environment(const struct kiln_import_params *params, struct kiln_confine *confine,
                           struct kiln_builder *builder, struct kiln_error *error)
{
    struct kiln_environment environment =
        KILN_BUILDER_DATA(builder, const struct kiln_environment, KILN_SECTION_ENVIRONMENT)[0];
    const char *asked = params->environment;
    if (asked != NULL && asked[0] != '\0') {
        environment = (struct kiln_environment){0};
        if (parse_radiance(asked, environment.radiance)) {
            environment.kind = KILN_ENVIRONMENT_CONSTANT;
        } else if (strcmp(asked, "none") != 0) {
            const int status = read_environment_image(params, confine, builder, &environment, error);
            if (status != KILN_OK)
                return status;
        }
    }
    for (int c = 0; c < 3; c++) {
        const double value = (double)environment.radiance[c] * params->environment_scale;
        if (!kiln_number_fits(KILN_NUMBER_LIGHT, value))
            return kiln_fail(
                error, KILN_USAGE,
                "--environment-scale %g turns the environment's radiance into %g (from %g): at most %g is possible",
                params->environment_scale, value, (double)environment.radiance[c], KILN_LIGHT_MOST);
        environment.radiance[c] = (float)value;
    }
    const int status = check_texels(builder, &environment, error);
    if (status != KILN_OK)
        return status;
    if (params->environment_scale == 0.0)
        environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_NONE};
    environment.rotation = (float)(fmod(params->environment_rotation_degrees, 360.0) * KILN_PI / 180.0);
    KILN_BUILDER_DATA(builder, struct kiln_environment, KILN_SECTION_ENVIRONMENT)[0] = environment;
    return KILN_OK;
}

/* Carries out what the job says of the whole scene. */
static int apply_settings(const struct kiln_import_params *params, struct kiln_confine *confine,
                          struct kiln_builder *builder, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_changes_apply(builder, params->changes, error));
    (void)kiln_fold_constant_textures(builder);
    KILN_TRY(set_environment(params, confine, builder, error));
    kiln_changes_apply_environment(builder, params->changes);
    KILN_TRY(kiln_object_settings_apply(builder, params->objects, error));
end:
    return status;
}

int kiln_import_read(const struct kiln_import_params *params, void (*mapped)(const struct kiln_confine *),
                     struct kiln_builder *builder, struct kiln_error *error)
{
    struct kiln_confine *confine = NULL;
    int status = kiln_confine_create(&confine, params->path, error);
    if (status != KILN_OK)
        return status;
    confine->mapped = mapped;
    builder->trust_normals = params->trust_normals;
    builder->strict = params->strict;
    builder->up_z = params->up_z;
    builder->unit = params->unit;
    switch (reader_of(confine->name)) {
    case READER_GLTF:
        status = params->up_z || (params->unit != 0.0 && params->unit != 1.0)
                     ? kiln_fail(error, KILN_USAGE,
                                 "%.512s: --up and --unit are for OBJ files: glTF is in metres, and its y points up; "
                                 "leave them out",
                                 params->path)
                     : kiln_gltf_read(confine, builder, error);
        break;
    case READER_OBJ:
        status = kiln_obj_read(confine, builder, error);
        break;
    case READER_PARTS:
        status =
            kiln_parts_read(confine, builder, params->environment != NULL && params->environment[0] != '\0', error);
        break;
    default:
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "%.512s: kiln does not read files of this name; give a .glb, .gltf, .obj or .kscene",
                           params->path);
    }
    if (status == KILN_OK && !params->part)
        status = apply_settings(params, confine, builder, error);
    if (status == KILN_OK)
        status = kiln_note_winding(builder, error);
    kiln_confine_destroy(&confine);
    return status;
}

/* Treatment of layouts, as a number. */
static int layout_of(const struct kiln_import_params *params)
{
    return params->part ? 4 : params->no_layout ? 2 : params->repack ? 1 : params->keep_shared ? 3 : 0;
}

void kiln_import_key(const struct kiln_import_params *params, uint64_t program, const struct kiln_source *sources,
                     size_t source_count, const char *strings, uint64_t key[2])
{
    char text[512];
    const bool automatic = params->texels_per_metre == 0.0 && params->lightmap_size == 0 && !params->no_layout;
    int length =
        snprintf(text, sizeof text, "%016llx %.17g %u %u %d %.17g %.17g %d %d %.17g %d ", (unsigned long long)program,
                 params->texels_per_metre, params->lightmap_size, params->lightmap_max, layout_of(params),
                 params->environment_scale, params->environment_rotation_degrees, params->trust_normals, params->up_z,
                 params->unit, params->strict);
    if (automatic && params->texels > 0.0) /* else the key is that of 0.1.0, whose checkpoints go on */
        length += snprintf(text + length, sizeof text - (size_t)length, "%.17g ", params->texels);
    const char *environment = params->environment == NULL ? "" : params->environment;
    XXH128_hash_t hash = XXH3_128bits(text, (size_t)length);
    hash = XXH3_128bits_withSeed(environment, strlen(environment), hash.low64 ^ hash.high64);
    const char *objects = params->objects == NULL ? "" : params->objects;
    hash = XXH3_128bits_withSeed(objects, strlen(objects), hash.low64 ^ hash.high64);
    if (params->changes != NULL)
        hash = XXH3_128bits_withSeed(params->changes, strlen(params->changes), hash.low64 ^ hash.high64);
    for (size_t i = 0; i < source_count; i++) {
        const char *path = strings + sources[i].path;
        const uint64_t numbers[5] = {hash.low64, hash.high64, sources[i].size, sources[i].hash[0], sources[i].hash[1]};
        hash = XXH3_128bits_withSeed(path, strlen(path), XXH3_64bits(numbers, sizeof numbers));
    }
    key[0] = hash.low64;
    key[1] = hash.high64;
}
