/* The scene file's checks on anything. The hash is made right first, so that the checks behind it are reached; then
 * every number and index that readers rely on is touched. */
#include <fcntl.h>
#include <string.h>

#include "tests/fuzz/fuzz.h"
#include "worker/scene/gloss.h"
#include "worker/scene/scene.h"
#include "worker/scene/texture.h"

static const char *with_right_hash(const uint8_t *data, size_t size)
{
    struct kiln_scene_header header;
    if (size < sizeof header)
        return fuzz_file(data, size, "scene.kscene");
    uint8_t *copy = malloc(size);
    if (copy == NULL)
        abort();
    memcpy(copy, data, size);
    memcpy(&header, copy, sizeof header);
    header.magic = KILN_SCENE_MAGIC;
    if (header.version < KILN_SCENE_VERSION_PLAIN || header.version > KILN_SCENE_VERSION_PART)
        header.version = KILN_SCENE_VERSION;
    header.size = size;
    const size_t header_bytes = kiln_scene_header_bytes(header.version);
    kiln_scene_content_hash(&header, copy + header_bytes, header.content_hash);
    memcpy(copy, &header, header_bytes);
    const char *path = fuzz_file(copy, size, "scene.kscene");
    free(copy);
    return path;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct kiln_scene *scene = NULL;
    struct kiln_error error = {""};
    const char *path = with_right_hash(data, size);
    int status = kiln_scene_open(&scene, path, &error);
    if (status != KILN_OK && error.message[0] != '\0' && strstr(error.message, "the scene file of a part") != NULL)
        status = kiln_scene_open_part(&scene, open(path, O_RDONLY | O_CLOEXEC), path, &error);
    if (status != KILN_OK && error.message[0] == '\0')
        abort();
    if (status != KILN_OK)
        return 0;
    float sum = 0.0f;
    for (size_t m = 0; m < scene->mesh_count; m++)
        for (uint64_t t = 0; t < scene->meshes[m].triangle_count && t < 64; t++) {
            float value[4];
            kiln_surface_color(scene, &scene->meshes[m], scene->meshes[m].triangle_first + t, 0.3f, 0.3f, value);
            sum += value[0];
            kiln_surface_emission(scene, &scene->meshes[m], scene->meshes[m].triangle_first + t, 0.3f, 0.3f, value);
            sum += value[0];
        }
    for (size_t m = 0; m < scene->material_count; m++) {
        const struct kiln_gloss *gloss = kiln_gloss_find(scene, (uint32_t)m);
        sum += kiln_gloss_needed(&scene->materials[m], gloss, KILN_GLOSS_MODE_AUTO) ? 1.0f : 0.0f;
        for (int i = 0; gloss != NULL && i < KILN_GLOSS_USES; i++) {
            float value[4] = {0.0f};
            if (gloss->textures[i].texture != KILN_NONE)
                kiln_texture_sample(scene, gloss->textures[i].texture, 0.3f, 0.3f, value);
            sum += value[gloss->textures[i].channel];
        }
    }
    size_t letters = 0;
    for (size_t i = 0; i < scene->object_count; i++)
        letters += strlen(kiln_scene_string(scene, scene->objects[i].name));
    kiln_scene_close(&scene);
    if (sum < 0.0f || letters > SIZE_MAX / 2)
        abort(); /* neither happens; both values are used, so that nothing above is optimised away */
    return 0;
}
