/* The glTF reader on anything: GLB when it begins so, else the JSON of a .gltf. What is taken must also lay out, write
 * and open. */
#include <string.h>

#include "coordinator/import/read.h"
#include "coordinator/layout/layout.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = fuzz_file(data, size, size >= 4 && memcmp(data, "glTF", 4) == 0 ? "scene.glb" : "scene.gltf");
    const struct kiln_import_params params = {.path = path, .environment_scale = 1.0};
    const struct kiln_layout_params layout = {.lightmap_size = 16};
    struct kiln_builder *builder = NULL;
    struct kiln_scene *scene = NULL;
    struct kiln_error error = {""};
    int status = kiln_builder_create(&builder, &error);
    if (status == KILN_OK)
        status = kiln_import_read(&params, NULL, builder, &error);
    if (status == KILN_OK)
        status = kiln_layout(builder, &layout, &error);
    if (status == KILN_OK) {
        const char *written = fuzz_file(NULL, 0, "scene.kscene");
        status = kiln_builder_write(builder, written, &error);
        if (status == KILN_OK && kiln_scene_open(&scene, written, &error) != KILN_OK) {
            (void)fprintf(stderr, "%s\n", error.message);
            abort(); /* what kiln writes it must read */
        }
    }
    if (status != KILN_OK && error.message[0] == '\0')
        abort(); /* a refusal without a sentence */
    kiln_scene_close(&scene);
    kiln_builder_destroy(&builder);
    return 0;
}
