/* Layout of a file of links (links.h). coordinator/integrate/patches/link_file.h writes and reads it.
 *
 * After a header comes a table with an entry for each tile run, in the global order, then the codes in that order. */
#ifndef KILN_WORKER_PASS_LINKS_FILE_H
#define KILN_WORKER_PASS_LINKS_FILE_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

#define KILN_LINKS_MAGIC "kilnlnks"
enum { KILN_LINKS_VERSION = 3, KILN_LINKS_BEGIN = 4096 }; /* bytes before the table */

/* The first bytes of the file; the rest up to KILN_LINKS_BEGIN is 0. Numbers are in the byte order of the machine. */
struct kiln_links_header {
    char magic[8];             /* KILN_LINKS_MAGIC, without its 0 */
    uint32_t version, samples; /* samples: rays of a point that close its row */
    double error;              /* of --patches links:E, as in struct kiln_links_parameters */
    uint64_t points, runs;     /* surface points and tile runs of the bake */
    uint64_t bytes, key;       /* size of the file; hash of all inputs of links and of the members above */
};

/* An entry of the table. For a tile run without links all members but `first` are 0. */
struct kiln_links_entry {
    uint64_t first, offset; /* global index of its first point; where its code begins, in bytes from the file's start */
    uint32_t bytes, links;  /* of its code; how many links it has */
    uint64_t check;         /* XXH3 of its code, seeded with the key and `first` */
};

/* Reads `bytes` bytes of the open file from byte `at` on. KILN_IO; KILN_BAD_INPUT, with a remedy, if it ends before.
 * Not collective. */
int kiln_links_read_at(int descriptor, const char *path, void *to, size_t bytes, uint64_t at, struct kiln_error *error);

/* Reads the complete open file, whose descriptor is borrowed, and checks it without the scene: the positions of all
 * parts, and the values of all links (kiln_links_check). KILN_BAD_INPUT, with a message that names `path` and the
 * place. Not collective. */
int kiln_links_file_check(int descriptor, const char *path, struct kiln_error *error);

#endif
