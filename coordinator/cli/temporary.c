#include "coordinator/cli/temporary.h"

#include <stdlib.h>
#include <unistd.h>

int kiln_temporary_make(struct kiln_temporary *temporary, struct kiln_error *error)
{
    const char *base = getenv("TMPDIR");
    temporary->scene_file[0] = '\0';
    int status = kiln_path_join(temporary->folder, base != NULL && base[0] != '\0' ? base : "/tmp", "kiln-XXXXXX", error);
    if (status == KILN_OK && mkdtemp(temporary->folder) == NULL) {
        status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot create a folder like %.500s", temporary->folder);
        temporary->folder[0] = '\0';
    }
    if (status == KILN_OK)
        status = kiln_path_join(temporary->scene_file, temporary->folder, "scene.kscene", error);
    return status;
}

void kiln_temporary_remove(const struct kiln_temporary *temporary)
{
    if (temporary->scene_file[0] != '\0')
        (void)unlink(temporary->scene_file);
    if (temporary->folder[0] != '\0')
        (void)rmdir(temporary->folder);
}
