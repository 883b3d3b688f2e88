/* Shared code of the fuzz targets: the input as a file in a folder of its own, which the reader is then pointed at. */
#ifndef KILN_TESTS_FUZZ_FUZZ_H
#define KILN_TESTS_FUZZ_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Writes the input to `name` in a folder made once per process and returns its path. */
static inline const char *fuzz_file(const uint8_t *data, size_t size, const char *name)
{
    static char folder[64], path[128];
    if (folder[0] == '\0') {
        (void)snprintf(folder, sizeof folder, "/tmp/kiln-fuzz-XXXXXX");
        if (mkdtemp(folder) == NULL)
            abort();
    }
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "wb");
    if (file == NULL || (size > 0 && fwrite(data, size, 1, file) != 1))
        abort();
    (void)fclose(file);
    return path;
}

#endif
