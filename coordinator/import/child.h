/* How the parent and the confined child talk: argv one way, one text the other. Private to import.c and child.c.
 *
 * argv: PROGRAM import-child PATH OUTPUT TEXELS_PER_METRE SIZE MAX ENVIRONMENT SCALE ROTATION MEMORY SECONDS PROGRAM_HASH
 * Standard output, at the end: the exit status in decimal, a line feed, and the sentence (empty on success). */
#ifndef KILN_COORDINATOR_IMPORT_CHILD_H
#define KILN_COORDINATOR_IMPORT_CHILD_H

enum { KILN_CHILD_ARGUMENTS = 14 };

#endif
