/* The identity of a bake: the scene's content and all settings that affect the light on its surfaces. Only a bake of
 * the same identity can continue a checkpoint. The settings of the probes are compared separately: probes are gathered
 * last, and if only their settings differ, only the probes are gathered again. Settings of the output files are not
 * part of the identity. */
#ifndef KILN_COORDINATOR_BAKE_IDENTITY_IDENTITY_H
#define KILN_COORDINATOR_BAKE_IDENTITY_IDENTITY_H

#include "coordinator/bake/prepare/prepare.h"

/* Creates the identity of a bake. Release with json_decref. NULL if memory is short. */
json_t *kiln_identity_make(const struct kiln_job *job, const struct kiln_prepared *prepared);

/* Returns KILN_OK if a checkpoint of identity `then` can be continued by a bake of identity `now`; else KILN_BAD_INPUT
 * with a table "field, in the checkpoint, now". The backend and instruction set may differ, since they give the same
 * light within its error but not the same bits; such a difference is described in `note` (empty: there is none). */
int kiln_identity_compare(const json_t *then, const json_t *now, const char *directory, char *note, size_t note_size,
                          struct kiln_error *error);

/* Whether both identities have the same settings of probes, so that the probes of the checkpoint can be used. */
bool kiln_identity_same_probes(const json_t *then, const json_t *now);

/* The backend and the instruction set that the checkpoint was made with, or NULL. */
const char *kiln_identity_backend(const json_t *identity);
const char *kiln_identity_instruction_set(const json_t *identity);

/* Whether the option `name` affects the light or the probes. *known: the option is on one of the lists in identity.c
 * or of a companion; a test checks that every option of bake is. */
bool kiln_identity_counts(const char *name, bool *known);

#endif
