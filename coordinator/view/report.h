/* report.html: one page without a script, a network or another file, from what a bake left in its folder. Not
 * collective. */
#ifndef KILN_COORDINATOR_VIEW_REPORT_H
#define KILN_COORDINATOR_VIEW_REPORT_H

#include "worker/base/status.h"

/* Reads DIR/run.json, DIR/preview.png and the lightmaps that run.json names and publishes `path`. Fields that run.json
 * lacks and pictures that are not there are left out of the page; a run.json that is not JSON is KILN_BAD_INPUT, none
 * is KILN_NO_INPUT. Lightmaps are shown tone-mapped, at most 160 pixels a side, at most 200 of them (the page says how
 * many there are), each with density, validity and error. A section, a row or a column that says nothing (zeros, empty
 * text, the balance of a single rank) is left out. */
int kiln_report_write(const char *directory, const char *path, struct kiln_error *error);

#endif
