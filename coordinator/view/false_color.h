/* Pictures of fields that are not colours: false colours with a scale, positions as red, green and blue, and colours
 * with a key. A legend below the picture shows the scale with its numbers, or the key, if the picture is at least
 * KILN_LEGEND_LEAST pixels wide. It is KILN_LEGEND_HEIGHT pixels high, twice that for pictures of 800 pixels or more.
 * Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_FALSE_COLOR_H
#define KILN_COORDINATOR_VIEW_FALSE_COLOR_H

#include "coordinator/view/view.h"

enum { KILN_LEGEND_LEAST = 160, KILN_LEGEND_HEIGHT = 44 };

/* Sets `low` and `high` of a picture from its finite values. KILN_FIELD_SCALE: the 0.5 % and 99.5 % percentiles of the
 * values from 0 on, the same for R, G, B. KILN_FIELD_PLACE: the minimum and maximum of each channel. All 0 without such
 * values. KILN_SYSTEM. */
int kiln_false_color_fit(struct kiln_picture *picture, struct kiln_error *error);

/* Publishes a picture of KILN_FIELD_SCALE, of KILN_FIELD_PLACE or with a key as PNG at the destination (publish.h).
 * Pixels without a value are grey. Negative values on a scale are marked orange. */
int kiln_false_color_write(const char *directory, const char *name, const struct kiln_picture *picture,
                           const char *description, struct kiln_error *error);

#endif
