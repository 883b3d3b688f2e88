/* What a checkpoint belongs to: the scene's content and every setting that has a say in the light on its surfaces; and
 * apart from that, the settings of the probes, which are gathered last and anew when those differ. What files are made
 * of the light is no part of it. */
#ifndef KILN_COORDINATOR_BAKE_IDENTITY_H
#define KILN_COORDINATOR_BAKE_IDENTITY_H

#include "coordinator/bake/prepare.h"

/* Makes the identity of a bake; json_decref it. NULL when out of memory. */
json_t *kiln_identity_make(const struct kiln_job *job, const struct kiln_prepared *prepared);

/* KILN_OK when a checkpoint of identity `then` may be gone on with as `now`; else KILN_BAD_INPUT with a table "field,
 * in the checkpoint, now". What computes does not count, but the first such difference is written to `note` (empty:
 * none): another backend or instruction set gives the same light within its error, not the same bits. */
int kiln_identity_compare(const json_t *then, const json_t *now, const char *directory, char *note, size_t note_size,
                          struct kiln_error *error);

/* Whether the probes that a checkpoint may hold are those that are wanted now. */
bool kiln_identity_same_probes(const json_t *then, const json_t *now);

/* The instruction set that a checkpoint was made with, or NULL. */
const char *kiln_identity_instruction_set(const json_t *identity);

/* Whether the value of the option `name` decides what is in the results. For tests: every option of bake is on one of
 * the lists. */
bool kiln_identity_counts(const char *name, bool *known);

#endif
