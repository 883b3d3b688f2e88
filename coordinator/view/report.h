/* The report of a bake, report.html: one self-contained page, without scripts, network access or other files. Not
 * collective. */
#ifndef KILN_COORDINATOR_VIEW_REPORT_H
#define KILN_COORDINATOR_VIEW_REPORT_H

#include "worker/base/status.h"

/* Reads DIR/run.json, DIR/preview.png and the lightmaps that run.json names, and publishes the page as `path`.
 * KILN_NO_INPUT if there is no run.json, KILN_BAD_INPUT if it is not JSON. Fields that run.json lacks and missing
 * pictures are left out; so are sections, rows and columns without information (zeros, empty text, the balance of a
 * single rank). At most 200 lightmaps are shown, with at most 160 pixels a side, tone-mapped, each with its density,
 * validity and error; the page says how many there are. */
int kiln_report_write(const char *directory, const char *path, struct kiln_error *error);

#endif
