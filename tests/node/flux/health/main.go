// Command health says what GitOps tools make of an object: kstatus, Flux' expressions on top of it, Argo CD's Lua.
//
// It reads one JSON document a line, {"object": ..., "expressions": {...}, "script": "..."}, and answers with one,
// {"kstatus": ..., "flux": ..., "argo": ...}. What fails is answered with its error.
package main

import (
	"bufio"
	"context"
	"encoding/json"
	"log"
	"os"

	"github.com/fluxcd/cli-utils/pkg/kstatus/status"
	"github.com/fluxcd/pkg/apis/kustomize"
	"github.com/fluxcd/pkg/runtime/cel"
	lua "github.com/yuin/gopher-lua"
	"k8s.io/apimachinery/pkg/apis/meta/v1/unstructured"
	luajson "layeh.com/gopher-json"
)

type question struct {
	Object      json.RawMessage                  `json:"object"`
	Expressions kustomize.HealthCheckExpressions `json:"expressions"`
	Script      string                           `json:"script"`
}

type answer struct {
	Kstatus string `json:"kstatus"`
	Flux    string `json:"flux"`
	Argo    string `json:"argo"`
}

func main() {
	lines := bufio.NewScanner(os.Stdin)
	for lines.Scan() {
		var asked question
		check(json.Unmarshal(lines.Bytes(), &asked))
		check(json.NewEncoder(os.Stdout).Encode(judge(asked)))
	}
	check(lines.Err())
}

func judge(asked question) answer {
	object := &unstructured.Unstructured{}
	check(object.UnmarshalJSON(asked.Object))
	return answer{
		Kstatus: said(status.Compute(object)),
		Flux:    said(flux(object, asked.Expressions)),
		Argo:    argo(asked.Object, asked.Script),
	}
}

func said(result *status.Result, err error) string {
	if err != nil {
		return "error: " + err.Error()
	}
	return result.Status.String()
}

func flux(object *unstructured.Unstructured, expressions kustomize.HealthCheckExpressions) (*status.Result, error) {
	evaluator, err := cel.NewStatusEvaluator(&expressions)
	if err != nil {
		return nil, err
	}
	return evaluator.Evaluate(context.Background(), object)
}

// As Argo CD runs a health script: with the libraries base, package and table, and the object as a global.
func argo(object json.RawMessage, script string) string {
	state := lua.NewState(lua.Options{SkipOpenLibs: true})
	defer state.Close()
	for _, library := range []struct {
		name string
		open lua.LGFunction
	}{{lua.LoadLibName, lua.OpenPackage}, {lua.BaseLibName, lua.OpenBase}, {lua.TabLibName, lua.OpenTable}} {
		check(state.CallByParam(lua.P{Fn: state.NewFunction(library.open), Protect: true}, lua.LString(library.name)))
	}
	value, err := luajson.Decode(state, object)
	check(err)
	state.SetGlobal("obj", value)
	if err := state.DoString(script); err != nil {
		return "error: " + err.Error()
	}
	verdict, ok := state.Get(-1).(*lua.LTable)
	if !ok {
		return "error: the script returns no table"
	}
	return verdict.RawGetString("status").String()
}

func check(err error) {
	if err != nil {
		log.Fatal(err)
	}
}
