# `make paper` regenerates the study, `make test` runs the tests; both set up their own environment in .venv.
# `make test-extras` runs the tests that need the optional extras or a browser, and the longest, `make docs` builds the pages
# into results/docs, `make validate` identifies public recordings of real systems, from the folder DATA or downloaded,
# `make install` and `make extras` set up the environment alone.
PYTHON ?= python3
VENV ?= .venv
CONSTRAINTS ?= constraints.txt

BIN := $(VENV)/bin
# What is used is compiled when it is first used, and kept: half of an installation's work would be to compile all the rest.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c $(CONSTRAINTS)
unexport PYTHONDONTWRITEBYTECODE
# A file's tests share what is costly to make, so they stay with one worker; `tests/conftest.py` says which come first.
PARALLEL := --numprocesses auto --dist loadfile --no-loadscope-reorder
# Only the model files of these packages are read, so they come without what their code needs.
MODELS := example-robot-data robosuite dm_control
BROWSER := tests/document/test_pages_in_browser.py
# Fuzzing, which damages files in the extras' formats as well, and those that take longest: whole studies of persons and of
# arms from files to answers, whose parts have tests of their own, and statistics of hundreds of trials. `make test` leaves
# them out.
LONG := tests/test_fuzz.py tests/studies/test_chair.py tests/studies/test_laboratory_arms.py \
	tests/studies/test_person_without_rail.py tests/studies/test_benchmark_run.py \
	tests/studies/test_gait.py::test_two_walks_are_identified_without_the_samples_beside_the_plates \
	tests/studies/test_noise.py::test_the_trajectory_estimate_is_right_where_least_squares_is_off_by_several_of_its_own \
	tests/studies/test_noise_conditions.py::test_conditions_run_from_end_to_end \
	tests/studies/test_monte_carlo.py::test_an_interrupt_ends_running_trials_without_a_traceback \
	tests/studies/test_trajectory_identification.py::test_an_arm_with_friction_is_predicted_as_well_as_with_the_best_filter_found_by_hand \
	tests/trajectory/test_late_start.py tests/test_payload.py tests/test_judged.py \
	tests/trajectory/test_unfollowed_jumps.py tests/trajectory/test_low_velocity.py \
	tests/test_unusual_recordings.py::test_a_trajectory_estimate_of_a_short_recording_needs_no_cut_off \
	tests/trajectory/test_reversals.py::test_a_drive_at_its_bound_has_a_one_sided_interval \
	tests/studies/test_human.py::test_a_person_from_a_wrong_prior \
	tests/studies/test_criteria.py::test_designs_by_deviations_beat_those_by_the_condition_number \
	tests/studies/test_preparation.py::test_a_moving_base_is_identified_from_its_contacts \
	tests/trajectory/test_smoothing_by_channel.py::test_somebody_who_lifts_is_judged_by_a_motion_as_good_as_her_angles \
	tests/trajectory/test_pieces.py::test_of_eight_recordings_the_intervals_cover_the_truth tests/studies/test_lifting.py \
	tests/studies/test_monte_carlo.py::test_a_request_to_end_ends_all_processes_without_a_traceback \
	tests/studies/test_monte_carlo.py::test_predicted_standard_deviations_are_right_for_wrench_noise \
	tests/studies/test_monte_carlo.py::test_standard_deviations_are_right_with_two_contacts \
	tests/studies/test_multicontact.py::test_weights_help_where_only_the_wrenches_are_noisy \
	tests/studies/test_misaligned.py::test_a_model_that_is_wrong_and_its_noise_do_not_chase_each_other \
	tests/studies/test_criteria.py::test_estimates_scatter_by_the_predicted_deviations \
	tests/studies/test_trajectory_identification.py::test_the_command_says_the_same_with_workers \
	tests/regression/test_ordinary.py::test_intervals_hold_for_noise_that_is_correlated_over_time \
	tests/regression/test_robust.py::test_standard_deviations_are_right_for_white_and_for_slow_noise \
	tests/docs/test_gallery.py tests/validation/test_validation.py tests/trajectory/test_wrench_beside_torques.py \
	tests/document/test_print.py::test_every_table_and_figure_compiles_without_overfull_boxes \
	tests/studies/test_human.py::test_the_first_seconds_tell_what_they_do_before_a_rest_that_is_not_measured \
	tests/studies/test_mechanism.py::test_everything_resumes_what_was_interrupted \
	tests/validation/test_fetch.py::test_one_that_broke_off_goes_on_and_is_validated \
	tests/test_coupled_motors.py::test_intervals_hold_the_motors_drives_as_often_as_they_say \
	tests/judgement/test_torque_loads.py::test_torques_that_are_a_seventh_too_large_are_a_finding_beside_a_plate \
	tests/studies/test_human.py::test_a_beginning_of_hardly_any_samples_tells_little \
	tests/test_commands.py::test_uncertain_gains_are_estimated_and_it_is_said_what_fixes_them \
	tests/studies/test_noise_conditions.py::test_some_conditions_may_be_chosen \
	tests/trajectory/test_left_out.py::test_an_interrupt_ends_every_stage \
	tests/studies/test_trajectory_identification.py::test_several_logs_share_parameters_and_have_delays_of_their_own \
	tests/readme/test_arm_log.py tests/studies/test_monte_carlo.py::test_any_executor_gives_the_same_numbers \
	tests/trajectory/fit/test_restricted_likelihood.py::test_smoothness_takes_nothing_of_the_motion_that_matters \
	tests/studies/test_excite.py::test_the_papers_excitation_is_improved_within_its_limits \
	tests/document/test_escape.py::test_commands_go_through_with_hostile_names \
	tests/studies/test_batch.py::test_every_log_has_results_and_a_failure_is_a_row \
	tests/studies/test_identify.py::test_a_contact_is_used_and_missed_when_left_out \
	tests/studies/test_monte_carlo.py::test_a_dead_worker_is_one_sentence_and_costs_no_trials \
	tests/studies/test_monte_carlo.py::test_both_studies_run_trials_from_the_command_line \
	tests/studies/test_sweep.py::test_a_sweep_is_the_study_with_every_value_and_seed \
	tests/trajectory/test_reversals.py::test_an_arm_whose_joints_rub \
	tests/trajectory/test_plates_jointly.py tests/studies/test_noise.py::test_more_recordings_may_follow_than_were_asked_for_at_first
# Those that skip without the extras or a browser, and the long ones.
OF_EXTRAS := $(LONG) $(BROWSER) tests/studies/test_derive.py tests/test_against_pinocchio.py tests/test_against_clarabel.py tests/test_against_sysid.py \
	tests/runs/test_cluster.py tests/cli/test_help.py::test_the_shell_completes_commands_and_options tests/docs/test_site.py tests/docs/test_notebook.py \
	tests/display/test_answers.py tests/recordings/test_in_memory.py \
	tests/studies/test_benchmark.py::test_peers_have_the_same_regressor \
	tests/test_against_models.py tests/parameters/test_large_trees.py tests/files/formats tests/recordings/test_several_files.py \
	tests/files/test_markers.py tests/models/test_xacro.py tests/studies/test_identify_formats.py tests/document/test_rerun_file.py tests/test_repository.py
INSTALLED := $(VENV)/installed-$(basename $(notdir $(CONSTRAINTS)))

.PHONY: paper test test-extras check docs readme validate install extras clean

paper: $(INSTALLED)
	$(BIN)/python -m experiments

test: $(INSTALLED)
	$(BIN)/python -m pytest $(PARALLEL) $(or $(TESTS),$(addprefix --deselect=,$(BROWSER) $(LONG)))

test-extras: extras
	$(BIN)/python -m pytest $(PARALLEL) $(OF_EXTRAS)

check: $(INSTALLED)
	$(PIP) ruff mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(INSTALLED)-docs
	$(BIN)/mkdocs build --strict --quiet
	@echo "The pages are in results/docs; open index.html."

readme: $(INSTALLED)
	$(BIN)/python -m experiments.readme

validate: $(INSTALLED)
	$(BIN)/python -m experiments.validate $(or $(DATA:%=--data %),$(if $(MULTICONTACT_DATA),,--fetch))

install: $(INSTALLED)

extras: $(INSTALLED)-extras

clean:
	rm -rf $(VENV) build dist *.egg-info results

# Once it is there, the pages are built without a network.
$(INSTALLED)-docs: $(INSTALLED)
	$(PIP) -e ".[test,docs]"
	touch $@

$(INSTALLED)-extras: $(INSTALLED)
	$(PIP) -e ".[test,symbolic,peers,cluster,completion,formats,notebook,rerun,xacro,docs]"
	$(PIP) --no-deps $(MODELS)
	touch $@

$(INSTALLED): pyproject.toml ident/model/blocks.c ident/model/kernels.h $(CONSTRAINTS)
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and \
		'Python 3.11 or newer is needed, $(PYTHON) is older: use make PYTHON=python3.12, say.')"
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e ".[test]"
	touch $@
