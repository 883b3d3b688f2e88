#include "coordinator/job/job_reader.h"

#include <string.h>

int kiln_job_next(struct kiln_job_reader *reader, yaml_event_t *event, struct kiln_error *error)
{
    if (yaml_parser_parse(&reader->parser, event) != 0)
        return KILN_OK;
    const yaml_parser_t *parser = &reader->parser;
    if (parser->error == YAML_MEMORY_ERROR)
        return kiln_fail(error, KILN_SYSTEM, "out of memory while reading job file %.500s", reader->path);
    if (parser->error == YAML_READER_ERROR) {
        size_t line = 1; /* line of the byte that is not text */
        for (size_t i = 0; i < parser->problem_offset && i < reader->length; i++)
            line += reader->text[i] == '\n';
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: is not text in UTF-8: %s", reader->path, line,
                         parser->problem != NULL ? parser->problem : "unreadable");
    }
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: is not YAML: %s%s%s", reader->path,
                     kiln_job_line(&parser->problem_mark), parser->problem != NULL ? parser->problem : "cannot be read",
                     parser->context != NULL ? " " : "", parser->context != NULL ? parser->context : "");
}

int kiln_job_expect_scalar(const struct kiln_job_reader *reader, const yaml_event_t *event, const char *what,
                           struct kiln_error *error)
{
    const size_t line = kiln_job_line(&event->start_mark);
    switch (event->type) {
    case YAML_SCALAR_EVENT:
        break;
    case YAML_ALIAS_EVENT:
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s is an alias (*); write the value itself",
                         reader->path, line, what);
    case YAML_SEQUENCE_START_EVENT:
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s is a list; it must be a single value", reader->path,
                         line, what);
    default:
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s is a mapping; it must be a single value",
                         reader->path, line, what);
    }
    if (strlen((const char *)event->data.scalar.value) != event->data.scalar.length)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s has a NUL character in it", reader->path, line,
                         what);
    return KILN_OK;
}

int kiln_job_expect(struct kiln_job_reader *reader, yaml_event_type_t type, const char *complaint,
                    struct kiln_error *error)
{
    yaml_event_t event;
    int status = kiln_job_next(reader, &event, error);
    if (status != KILN_OK)
        return status;
    if (event.type != type)
        status = kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s", reader->path, kiln_job_line(&event.start_mark),
                           complaint);
    yaml_event_delete(&event);
    return status;
}
