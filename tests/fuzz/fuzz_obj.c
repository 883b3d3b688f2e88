/* The OBJ walk that comes before Assimp: what it lets pass is Assimp's to read, what it refuses has a sentence. */
#include "coordinator/import/obj.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct kiln_error error = {""};
    if (kiln_obj_check("scene.obj", data, size, &error) != KILN_OK && error.message[0] == '\0')
        abort();
    return 0;
}
