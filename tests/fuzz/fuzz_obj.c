/* OBJ and MTL: the input up to its first NUL is scene.obj, the rest m.mtl beside it. Whatever they are, the reader
 * gives a scene or a sentence. */
#include <string.h>

#include "coordinator/import/read.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const uint8_t *split = size == 0 ? NULL : memchr(data, 0, size);
    const size_t length = split == NULL ? size : (size_t)(split - data), rest = split == NULL ? 0 : size - length - 1;
    (void)fuzz_file(split == NULL ? data : split + 1, rest, "m.mtl");
    const struct kiln_import_params params = {.path = fuzz_file(data, length, "scene.obj")};
    struct kiln_builder *builder = NULL;
    struct kiln_error error = {""};
    int status = kiln_builder_create(&builder, &error);
    if (status == KILN_OK)
        status = kiln_import_read(&params, NULL, builder, &error);
    if (status != KILN_OK && error.message[0] == '\0')
        abort(); /* a refusal without a sentence */
    kiln_builder_destroy(&builder);
    return 0;
}
